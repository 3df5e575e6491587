"""Ctrl-C ends an installed node cleanly at any moment."""

import os
import time
from collections.abc import Callable
from signal import SIGINT
from typing import Any

import pytest
from support.processes import node_command
from support.waiting import wait_for_import

pytestmark = pytest.mark.ros


@pytest.mark.parametrize("name", ["adapter", "driver", "filter", "mapping", "simulator"])
def test_an_interrupt_during_the_imports_is_no_crash(process: Callable[..., Any], name: str) -> None:
    for package in ("numpy", "rclpy"):
        node = process(node_command(f"{name}_node", {"autostart": False}))  # runs until it is interrupted
        wait_for_import(node.pid, package)
        assert node.stop() == 0
        assert "Traceback" not in node.output


@pytest.mark.parametrize("pause_s", [0.005, 0.0])
def test_interrupts_after_the_first_are_ignored(
    process: Callable[..., Any], probe: Any, pause_s: float
) -> None:
    """Ctrl-C reaches a launched node twice, from the terminal and from launch: also within the handler."""
    reports, name = probe.diagnostics(), f"interrupted_{1e3 * pause_s:.0f}"
    node = process(node_command("adapter_node", remaps={"__node": name}))

    def is_active() -> bool:
        return any(name in status.name for each in reports for status in each.status)

    probe.until(is_active, "the active node")
    while node.running:
        os.kill(node.pid, SIGINT)
        time.sleep(pause_s)
    assert node.wait() == 0, node.output
