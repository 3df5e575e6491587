"""Exit status and error messages of ``ros2 launch``."""

from __future__ import annotations

import os
import re
import shutil
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from support.bags import slide, write_bag
from support.processes import Process
from support.scenarios import Place, ros2_bag, write_sweep_bag
from support.waiting import children, wait_until

pytest.importorskip("ros2launch", reason="ros2launch is not installed: only a ROS 2 distribution has it")

pytestmark = pytest.mark.ros

FOLDER = Path(__file__).parents[2] / "launch"

Launch = Callable[..., Process]


@pytest.fixture
def launch(process: Any, tmp_path: Path) -> Launch:
    """``launch("bringup", scan_file=...)`` runs ``ros2 launch`` on a launch file."""
    command = shutil.which("ros2")
    assert command is not None
    path = f"{Path(ros2_bag()).parent}{os.pathsep}{os.environ['PATH']}"

    def start(name: str, **arguments: Any) -> Process:
        given = [f"{argument}:={value}" for argument, value in arguments.items()]
        environment = {"ROS_HOME": str(tmp_path), "ROS_LOG_DIR": str(tmp_path / "log"), "PATH": path}
        launched: Process = process(
            [command, "launch", str(FOLDER / f"{name}.launch.py"), *given], environment
        )
        return launched

    return start


def localizing(place: Place) -> dict[str, Any]:
    return {"scan_file": place.scan_file, **place.buses[0]}


def child(launched: Process, name: str) -> int:
    """Process id of a node."""
    wait_until(lambda: launched.running and f"{name}_node-" in launched.output, name)
    found = [
        int(pid)
        for pid in re.findall(rf"{name}_node-\d+\]: process started with pid \[(\d+)\]", launched.output)
    ]
    assert found, launched.output
    return found[-1]


@pytest.mark.parametrize(
    ("name", "argument", "value", "expected"),
    [
        ("simulate", "speed", "fast", "speed: expected a number, got 'fast'"),
        ("bringup", "queue_depth", "deep", "queue_depth: expected a whole number, got 'deep'"),
        ("bringup", "phalanges", "[]", "phalanges: expected a list of names"),
        ("bringup", "phalanges", "[index", "phalanges: expected a list of names"),
        ("bringup", "phalanges", "[" * 2000, "phalanges: expected a list of names"),
        ("bringup", "bus_options", "[!!timestamp 2024-99-99]", "bus_options: expected a list of names"),
        (
            "bringup",
            "filter_params",
            "none.yaml",
            "filter_params: expected an existing file, got 'none.yaml'",
        ),
    ],
)
def test_an_invalid_argument_is_named(
    launch: Launch, name: str, argument: str, value: str, expected: str
) -> None:
    launched = launch(name, **{argument: value})
    assert launched.wait() == 1
    found = [line for line in launched.lines if "ERROR" in line and f"launch argument {expected}" in line]
    assert len(found) == 1, launched.output


@pytest.mark.parametrize("name", ["bringup", "localize", "replay", "scan", "sensor", "simulate"])
def test_a_launch_file_is_found_by_its_name(process: Any, name: str) -> None:
    ros2 = shutil.which("ros2")
    launched = process([ros2, "launch", "tactile_localizer", f"{name}.launch.py", "--show-args"])
    assert launched.wait() == 0, launched.output


@pytest.mark.parametrize(
    ("name", "argument", "value"),
    [
        ("simulate", "mode", "locolize"),
        ("localize", "use_sim_time", "yess"),
        ("localize", "log_level", "loud"),
    ],
)
def test_an_argument_has_its_choices(launch: Launch, name: str, argument: str, value: str) -> None:
    launched = launch(name, **{argument: value})
    assert launched.wait() == 1
    assert f'Argument "{argument}" provided value "{value}" is not valid' in launched.output
    assert "process started" not in launched.output


def test_a_rejected_configuration_ends_the_launch(launch: Launch, place: Place) -> None:
    launched = launch("bringup", dbc=place.folder / "none.dbc", **localizing(place))
    assert launched.wait() == 1
    assert "driver: expected a running node, it ended with status 2" in launched.output


def test_a_missing_scan_ends_the_launch(launch: Launch, tmp_path: Path) -> None:
    launched = launch("localize", scan_file=tmp_path / "none_scan")
    assert launched.wait() == 1
    assert "filter: expected a running node, it ended with status 2" in launched.output


def test_a_crashed_node_ends_the_launch(launch: Launch, place: Place) -> None:
    launched = launch("localize", scan_file=place.scan_file)
    launched.wait_for_line("pairs of")
    os.kill(child(launched, "filter"), signal.SIGKILL)
    assert launched.wait() == 1
    assert children(launched.pid) == []


def test_with_respawn_a_crashed_node_is_restarted(launch: Launch, place: Place) -> None:
    launched = launch("localize", scan_file=place.scan_file, respawn="true")
    launched.wait_for_line("pairs of")
    first = child(launched, "filter")
    os.kill(first, signal.SIGKILL)
    wait_until(lambda: child(launched, "filter") != first, "the filter's next process")
    assert launched.stop() == 0


def test_with_respawn_a_rejected_configuration_ends_the_launch(launch: Launch, tmp_path: Path) -> None:
    launched = launch("localize", scan_file=tmp_path / "none_scan", respawn="true")
    assert launched.wait() == 1
    assert launched.output.count("process started") == 1


def test_a_parameter_file_replaces_the_shipped_one(launch: Launch, place: Place) -> None:
    file = place.folder / "mine.yaml"
    file.write_text(f"/**:\n  ros__parameters:\n    scan_file: {place.folder / 'other_scan'}\n")
    launched = launch("localize", filter_params=file)
    assert launched.wait() == 1
    assert "other_scan: expected a scan folder" in launched.output


def test_the_parameter_file_supplies_defaults(launch: Launch, place: Place) -> None:
    file = place.folder / "mine.yaml"
    file.write_text("/**:\n  ros__parameters:\n    publish_tf: true\n    reference_frame: ''\n")
    launched = launch("localize", filter_params=file, scan_file=place.scan_file)
    assert launched.wait() == 1
    assert "publish_tf: expected a reference_frame" in launched.output


@pytest.mark.parametrize("rate", [1.0, 3.0, 10.0])
def test_a_replay_loses_nothing(launch: Launch, place: Place, rate: float) -> None:
    launched = launch(
        "replay", bag=write_sweep_bag(place.folder / "bag"), scan_file=place.scan_file, rate=rate
    )
    assert launched.wait(90.0) == 0, launched.output
    assert "the bag has ended: 371 strain vectors, 371 posteriors, 0 lost" in launched.output


def test_a_replay_of_nothing_fails(launch: Launch, place: Place) -> None:
    poses = [one for one in slide(0, 500) if one[0] == "palm_pose"]
    launched = launch("replay", bag=write_bag(place.folder / "bag", poses), scan_file=place.scan_file)
    assert launched.wait(60.0) == 1
    assert "expected strain on /strain, found none" in launched.output


def test_a_replay_with_a_missing_scan_fails(launch: Launch, place: Place) -> None:
    launched = launch(
        "replay", bag=write_sweep_bag(place.folder / "bag"), scan_file=place.folder / "none_scan"
    )
    assert launched.wait(60.0) == 1
    assert "filter: expected a running node, it ended with status 2" in launched.output
    assert "ros2 bag" not in launched.output


@pytest.mark.parametrize("delay_s", [0.1, 0.3, 0.5, 0.7, 0.9])
def test_ctrl_c_during_the_imports_is_no_crash(launch: Launch, place: Place, delay_s: float) -> None:
    launched = launch("localize", scan_file=place.scan_file)
    launched.wait_for_line("process started")
    time.sleep(delay_s)
    os.killpg(launched.pid, signal.SIGINT)  # as a terminal does
    launched.wait()
    assert "process has died" not in launched.output, launched.output
    assert "Traceback" not in launched.output


def test_ctrl_c_ends_running_nodes_cleanly(launch: Launch, place: Place) -> None:
    launched = launch("bringup", **localizing(place))
    launched.wait_for_line("pairs of")
    os.killpg(launched.pid, signal.SIGINT)
    assert launched.wait() == 0, launched.output
    assert launched.output.count("process has finished cleanly") == 2, launched.output
