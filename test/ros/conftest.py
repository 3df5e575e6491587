"""Valid parameters of the nodes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from support.bags import SCENE
from support.sweeps import write_scan

from tactile_localizer.io.scene_file import save_scene
from tactile_localizer.sim import shipped_scene


@pytest.fixture(scope="session")
def scan_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A calibrated scan of the bump, which no test changes."""
    path = tmp_path_factory.mktemp("scans") / "bump_scan"
    write_scan(path)
    return path


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    """Parameters of a mapping node for the sheet of :mod:`support.bags`, and a scan that is not there yet."""
    save_scene(SCENE, tmp_path / "scene.yaml")
    return {"scene_file": tmp_path / "scene.yaml", "scan_file": tmp_path / "bump_scan"}


@pytest.fixture
def valid(bus: dict[str, Any], tmp_path: Path) -> dict[str, dict[str, Any]]:
    """Parameters with which each node can be configured soon, by its name."""
    write_scan(tmp_path / "short_scan", short=True)
    save_scene(shipped_scene("bump"), tmp_path / "scene.yaml")
    return {
        "adapter": {"adapter_file": "wrench.yaml"},
        "driver": {**bus, "tare_file": tmp_path / "tare.yaml"},
        "filter": {"scan_file": tmp_path / "short_scan", "cell": 2.0},
        "mapping": {"scene_file": tmp_path / "scene.yaml", "scan_file": tmp_path / "bump_scan"},
        "simulator": bus,
    }
