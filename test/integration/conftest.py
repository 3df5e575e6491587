"""Fixtures: a driver node and its simulated bus."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import can
import pytest
from support.processes import node_command


@pytest.fixture
def can_bus(simulated_can: dict[str, Any]) -> Iterator[can.BusABC]:
    """The simulated bus, for sending frames."""
    bus = can.Bus(**simulated_can, hop_limit=0)
    yield bus
    bus.shutdown()


@pytest.fixture
def driver_process(
    process: Callable[..., Any], simulated_can: dict[str, Any], tmp_path: Path
) -> Callable[..., Any]:
    """Start an installed driver on the simulated bus; arguments are parameters."""
    parameters = {
        "interface": simulated_can["interface"],
        "channel": simulated_can["channel"],
        "bus_options": [f"port={simulated_can['port']}"],
        "tare_file": str(tmp_path / "tare.yaml"),
        "period_s": 0.4,  # on a busy machine the test can pause between two frames,
        "max_age_s": 60.0,  # or the driver before it reads them
    }
    return lambda **more: process(node_command("driver_node", {**parameters, **more}))
