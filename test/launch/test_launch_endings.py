"""``ros2 launch`` of the launch files, to its end."""

import os
import re
import signal
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest
from support.bags import pose, strain, write_bag
from support.launching import Launch
from support.scenarios import Place
from support.sweeps import unseen_sweep
from support.waiting import wait_for_import, wait_until

pytest.importorskip("ros2launch", reason="ros2launch is not installed: only a ROS 2 distribution has it")

pytestmark = pytest.mark.ros

NODE = {"namespace", "params_file", "use_sim_time", "autostart", "log_level"}
ARGUMENTS = {
    "bringup": {"scan_file", "pose_topic", "sensor", *NODE},
    "localize": {"scan_file", "pose_topic", *NODE},
    "replay": {"bag", "rate", "scan_file", "pose_topic", "namespace", "params_file", "log_level"},
    "scan": {"scan_file", "scene_file", "pose_topic", "sensor", *NODE},
    "sensor": {"sensor", *NODE},
    "simulate": {"mode", "scan_file", "scene_file", *NODE},
}
REQUIRED = {"scan_file": "none", "scene_file": "bump.yaml", "bag": "none", "mode": "localize"}
"""Arguments without a default, each with a value."""


@pytest.mark.parametrize("name", ARGUMENTS)
def test_every_argument_is_shown_with_its_description(launch: Launch, name: str) -> None:
    launched = launch(name, "--show-args")
    assert launched.wait() == 0, launched.output
    shown = re.findall(r"^ {4}'(\w+)':\n {8}(.+)", launched.output, re.MULTILINE)
    assert {argument for argument, _ in shown} == ARGUMENTS[name]
    assert not [argument for argument, text in shown if "no description given" in text]


def test_an_argument_has_its_choices(launch: Launch) -> None:
    launched = launch("simulate", mode="locolize", scan_file="none")
    assert launched.wait() == 1
    assert 'Argument "mode" provided value "locolize" is not valid' in launched.output
    assert "process started" not in launched.output


@pytest.mark.parametrize(
    ("name", "missing"),
    [
        (name, missing)
        for name, known in ARGUMENTS.items()
        for missing in sorted(known & {*REQUIRED})
        if (name, missing) != ("simulate", "scene_file")  # which has a default
    ],
)
def test_no_node_starts_before_every_argument_is_known(launch: Launch, name: str, missing: str) -> None:
    given = {one: value for one, value in REQUIRED.items() if one in ARGUMENTS[name] - {missing}}
    launched = launch(name, **given)
    assert launched.wait() == 1
    assert f"missing required argument '{missing}'" in launched.output
    assert "process started" not in launched.output


@pytest.mark.parametrize("name", ARGUMENTS)
def test_a_missing_parameter_file_ends_the_launch(launch: Launch, name: str) -> None:
    given = {one: value for one, value in REQUIRED.items() if one in ARGUMENTS[name]}
    launched = launch(name, params_file="nosuch.yaml", **given)
    assert launched.wait() == 1
    assert "params_file: expected a file, found none: nosuch.yaml" in launched.output
    assert "_node-" not in launched.output


def test_a_misspelt_name_is_warned_of(launch: Launch, place: Place) -> None:
    file = place.folder / "mine.yaml"
    file.write_text("/**/tactile_fliter:\n  ros__parameters: {cell: 1.0}\n/arm:\n  ros__parameters: {a: 1}\n")
    launched = launch("localize", params_file=file, scan_file="none", pose_topc="/arm/palm_pose", arm="left")
    launched.wait()
    warnings = re.findall(r"\[WARNING\].*?: (.*)", launched.output)
    assert warnings == [
        "argument pose_topc: expected pose_topic; it is ignored",
        f"{file}: tactile_fliter: expected tactile_filter; it is ignored",
    ]


BRINGUP = """
from launch import LaunchDescription
from launch.actions import GroupAction, IncludeLaunchDescription
from launch_ros.substitutions import FindPackageShare

def hand(side):
    bringup = [FindPackageShare("tactile_localizer"), "/launch/localize.launch.py"]
    given = {"scan_file": "SCAN", "namespace": side, "params_file": f"{side}.yaml"}
    return GroupAction([IncludeLaunchDescription(bringup, launch_arguments=given.items())])

def generate_launch_description():
    return LaunchDescription([hand("left"), hand("right")])
"""


def test_a_hand_that_cannot_start_stops_the_other(
    launch: Launch, place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(place.folder)
    Path("left.yaml").touch()
    Path("two_hands.launch.py").write_text(BRINGUP.replace("SCAN", str(place.scan_file)))
    launched = launch(Path("two_hands.launch.py"))
    started = launched.wait_for_line(r"filter_node-1.: process started with pid \[\d+\]")
    assert launched.wait() == 1
    assert "params_file: expected a file, found none: right.yaml" in launched.output
    pid = int(re.findall(r"\[(\d+)\]", started)[-1])
    assert not Path(f"/proc/{pid}").exists()


@pytest.mark.parametrize(("name", "status"), [("localize", 0), ("replay", 1)])
def test_a_missing_scan_is_named(launch: Launch, tmp_path: Path, name: str, status: int) -> None:
    given = {"bag": "none"} if name == "replay" else {}
    launched = launch(name, scan_file=tmp_path / "none_scan", **given)
    assert launched.wait() == status
    assert "none_scan: expected a scan folder, found none" in launched.output
    assert "Traceback" not in launched.output


def test_a_level_of_the_log_is_passed_on(launch: Launch) -> None:
    launched = launch("localize", scan_file="none", log_level="debug")
    launched.wait()
    assert "[DEBUG]" in launched.output


def test_arguments_override_the_parameter_file(launch: Launch, place: Place) -> None:
    file = place.folder / "mine.yaml"
    file.write_text(
        "/**/tactile_filter:\n  ros__parameters: {scan_file: other, publish_tf: true, reference_frame: ''}\n"
    )
    launched = launch("localize", params_file=file, scan_file=place.scan_file)
    launched.wait()
    assert "publish_tf: expected a reference_frame" in launched.output


@pytest.mark.parametrize("where", [{}, {"namespace": "left"}], ids=["root", "namespace"])
def test_a_bag_is_played_once_the_filter_is_active(
    launch: Launch, place: Place, where: dict[str, str]
) -> None:
    launched = launch("replay", bag="none", scan_file=place.scan_file, **where)
    assert launched.wait(60.0) == 1, "there is no bag"
    loading, playing = (launched.output.partition(text)[0] for text in ("pairs of", "ros2 bag play none"))
    assert len(loading) < len(playing) < len(launched.output), launched.output


with_rosbag2 = pytest.mark.skipif(
    "bag" not in entry_points(group="ros2cli.command").names, reason="ros2 bag is not installed"
)


def sweep_bag(folder: Path, storage: str, topics: tuple[str, ...]) -> Path:
    """A bag of one sweep, with strain and poses at 50 Hz."""
    sweep, messages = unseen_sweep(rate=50.0), []
    for k, (x, y) in enumerate(sweep.position):
        stamp_ms, felt = 1000 + 20 * k, {"strain": sweep.strain[k], "sequence": np.full(2, k, np.uint32)}
        messages.append(("palm_pose", stamp_ms, pose(stamp_ms, "base_link", x, y)))
        messages.append(("strain", stamp_ms, strain(stamp_ms, ("index", "middle"), **felt)))
    return write_bag(folder / "bag", [one for one in messages if one[0] in topics], storage)


@with_rosbag2
@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_replay_ends_with_its_bag_and_loses_nothing(launch: Launch, place: Place, storage: str) -> None:
    bag = sweep_bag(place.folder, storage, ("strain", "palm_pose"))
    launched = launch("replay", bag=bag, scan_file=place.scan_file)
    assert launched.wait(90.0) == 0, launched.output
    assert "371 strain vectors received, 371 posteriors, 0 without a pose, 0 lost" in launched.output


@with_rosbag2
def test_a_replay_without_a_posterior_fails(launch: Launch, place: Place) -> None:
    bag = sweep_bag(place.folder, "mcap", ("strain",))
    launched = launch("replay", bag=bag, scan_file=place.scan_file, rate=5.0)
    assert launched.wait(90.0) == 1
    assert "bag: expected posteriors, found none" in launched.output
    assert " 0 posteriors" in launched.output, "the filter ended by itself"


@pytest.mark.parametrize("module", ["numpy", "scipy", "rclpy"])
def test_ctrl_c_during_the_imports_is_no_crash(launch: Launch, place: Place, module: str) -> None:
    launched = launch("localize", scan_file=place.scan_file)
    started = launched.wait_for_line(r"process started with pid \[\d+\]")
    wait_for_import(int(re.findall(r"\[(\d+)\]", started)[-1]), module)
    os.killpg(launched.pid, signal.SIGINT)  # as a terminal does
    launched.wait()
    assert "process has died" not in launched.output, launched.output
    assert "Traceback" not in launched.output


def test_ctrl_c_ends_running_nodes_cleanly(launch: Launch, place: Place) -> None:
    file = place.folder / "hand.yaml"
    file.write_text(f"/**/tactile_driver:\n  ros__parameters: {dict(place.buses[0])}\n")
    launched = launch("bringup", scan_file=place.scan_file, params_file=file)
    launched.wait_for_line("pairs of")
    wait_until(lambda: "CAN bus: open" in launched.output, "the driver")
    os.killpg(launched.pid, signal.SIGINT)
    assert launched.wait() == 0, launched.output
    assert launched.output.count("process has finished cleanly") == 2, launched.output
