"""Valid parameters of the nodes."""

import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from support.bags import SCENE
from support.hand import DEEP_QUEUE, Hand
from support.processes import Process, node_command
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
def construct() -> Iterator[Any]:
    """Construct a node in this process, in place of the one before: ``construct("driver", parameters)``."""
    made: list[Any] = []

    def close() -> None:
        for node in made:
            node.close()
            node.destroy_node()
        made.clear()
        rclpy.try_shutdown()

    def start(name: str, parameters: dict[str, Any]) -> Any:
        close()
        rclpy.init(args=node_command(f"{name}_node", parameters)[1:])
        module = importlib.import_module(f"tactile_localizer.ros.{name}_node")
        made.append(getattr(module, f"{name.title()}Node")())
        return made[0]

    yield start
    close()


@pytest.fixture
def mapping(node_process: Any, probe: Any, files: dict[str, Path]) -> Any:
    """Start a mapping node: ``mapping(patience_s=1.0)`` is its process, and the hand that it records."""

    def start(node: str = "tactile_mapping", **parameters: Any) -> tuple[Process, Hand]:
        process = node_process("mapping_node", {**files, **DEEP_QUEUE, **parameters}, {"__node": node})
        return process, Hand(probe, node)

    return start


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
