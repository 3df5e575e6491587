"""Every launch file in the bringup of somebody else: in a group, in a namespace, beside other processes."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from support.launching import Launch
from support.probe import Probe
from support.processes import Process
from support.scenarios import Place

pytest.importorskip("ros2launch", reason="ros2launch is not installed: only a ROS 2 distribution has it")

pytestmark = pytest.mark.ros

FOLDER = Path(__file__).parents[2] / "launch"
NODES = {
    "bringup": ("driver", "filter"),
    "localize": ("filter",),
    "replay": ("filter",),
    "scan": ("driver", "mapping"),
    "sensor": ("driver",),
    "simulate": ("simulator", "driver", "filter"),
}
BRINGUP = """
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, GroupAction, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import PushRosNamespace, SetParameter
from launch_ros.substitutions import FindPackageShare

OWN = ("my_scan", "my_file", "param_file", "scan_files", "namespaces")

def generate_launch_description():
    file = [FindPackageShare("tactile_localizer"), "/launch/NAME.launch.py"]
    given = {name: LaunchConfiguration(value, default=value) for name, value in GIVEN.items()}
    include = IncludeLaunchDescription(file, launch_arguments=given.items())
    around = [PushRosNamespace("robot"), SetParameter("use_sim_time", True)]
    own = [DeclareLaunchArgument(name) for name in OWN]
    return LaunchDescription([*own, ExecuteProcess(cmd=["true"]), GroupAction([*around, include])])
"""

ELSEWHERE = """
from launch import LaunchDescription
from launch.actions import GroupAction, OpaqueFunction, SetEnvironmentVariable
from launch.launch_description_sources import load_python_launch_file_as_module
from launch_ros.ros_adapters import get_ros_node

def generate_launch_description():
    file = load_python_launch_file_as_module(FILE)
    file.ANSWER_S = 1.0
    here = OpaqueFunction(function=lambda context: get_ros_node(context) and None)
    elsewhere = SetEnvironmentVariable("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
    return LaunchDescription([here, GroupAction([elsewhere, file.generate_launch_description()])])
"""
"""A replay whose filter is where launch does not see it."""


@pytest.fixture
def bringup(launch: Launch, place: Place) -> Any:
    """``bringup("scan")`` includes a launch file, with arguments that the command line names otherwise."""

    def start(name: str) -> Process:
        file, params_file = place.folder / "bringup.launch.py", place.folder / "mine.yaml"
        bus = {"ros__parameters": dict(place.buses[0])}
        params_file.write_text(json.dumps({"/**/tactile_driver": bus, "/**/tactile_simulator": bus}))
        scan_file = place.folder / "new_scan" if name == "scan" else place.scan_file
        of_file = {
            "replay": {"bag": "none", "rate": "2.0"},
            "scan": {"scene_file": "bump.yaml"},
            "simulate": {"mode": "localize"},
        }
        given = {"namespace": "hand", "params_file": "my_file", **of_file.get(name, {})}
        given |= {} if name == "sensor" else {"scan_file": "my_scan"}
        file.write_text(BRINGUP.replace("NAME", name).replace("GIVEN", repr(given)))
        own = {"param_file": "a", "scan_files": "b", "namespaces": "c"}
        return launch(file, my_scan=scan_file, my_file=params_file, **own)

    return start


def test_every_file_is_tried() -> None:
    assert {path.name.partition(".")[0] for path in FOLDER.iterdir() if path.suffix == ".py"} == {*NODES}


@pytest.mark.parametrize("name", {*NODES} - {"replay"})
def test_a_file_takes_what_is_around_it(bringup: Any, probe: Probe, name: str) -> None:
    from rcl_interfaces.srv import GetParameters

    launched = bringup(name)
    for node in NODES[name]:
        request = GetParameters.Request(names=["use_sim_time"])
        (value,) = probe.call(GetParameters, f"robot/hand/tactile_{node}/get_parameters", request).values
        assert value.bool_value
    assert "it is ignored" not in launched.output


def test_a_replay_plays_in_the_bringup_of_somebody_else(bringup: Any) -> None:
    launched = bringup("replay")
    assert launched.wait() == 1, "there is no bag"
    assert "pairs of" in launched.output.partition("ros2 bag play none")[0]
    assert "--rate 2.0" in launched.output
    assert re.search(r"replay: ros2-\d+ ended with status", launched.output)
    assert "it is ignored" not in launched.output


def test_a_replay_ends_if_its_filter_does_not_answer(launch: Launch, place: Place) -> None:
    file = place.folder / "elsewhere.launch.py"
    file.write_text(ELSEWHERE.replace("FILE", repr(str(FOLDER / "replay.launch.py"))))
    launched = launch(file, bag="none", scan_file=place.scan_file)
    assert launched.wait() == 1
    assert "/tactile_filter: expected an answer within 1 s, got none" in launched.output
