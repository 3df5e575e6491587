"""The launch files in launch files of others, read by the real launch system."""

from pathlib import Path
from typing import Any

import pytest
from support.probe import Probe
from support.scenarios import Place

launch_pytest = pytest.importorskip(
    "launch_pytest", reason="launch_pytest is not installed: only a ROS 2 distribution has it"
)

from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription  # noqa: E402
from launch.launch_description_sources import PythonLaunchDescriptionSource  # noqa: E402
from launch_pytest.actions import ReadyToTest  # noqa: E402
from launch_ros.actions import Node, PushRosNamespace, SetParameter, SetRemap  # noqa: E402

from launch import LaunchContext, LaunchDescription  # noqa: E402

pytestmark = pytest.mark.ros

ROOT = Path(__file__).parents[2]


def localize(**given: Any) -> IncludeLaunchDescription:
    """The filter, with launch arguments."""
    arguments = [(name, str(value)) for name, value in given.items()]
    return IncludeLaunchDescription(str(ROOT / "launch/localize.launch.py"), launch_arguments=arguments)


@launch_pytest.fixture
def two_hands(place: Place, monkeypatch: Any) -> Any:
    """Two filters in the bringup of an integrator: one by actions of launch_ros, one by arguments."""
    monkeypatch.setenv("ROS_HOME", str(place.folder))
    left = [
        PushRosNamespace("left"),
        SetRemap("palm_pose", "/left_arm/pose"),
        SetRemap("strain", "/left_hand/strain"),
        localize(scan_file=place.scan_file),
    ]
    given = {"namespace": "right", "pose_topic": "/right_arm/pose", "use_sim_time": False}
    right = [localize(scan_file=place.scan_file, **given)]
    around = [
        PushRosNamespace("robot"),
        SetParameter("use_sim_time", True),
        SetParameter("queue_depth", 1000),
    ]
    return LaunchDescription([*around, GroupAction(left), GroupAction(right), ReadyToTest()])


@pytest.mark.launch(fixture=two_hands)
def test_what_an_integrator_sets_is_used(two_hands: Any, probe: Probe) -> None:
    from rcl_interfaces.srv import GetParameters

    def values(hand: str) -> list[Any]:
        request = GetParameters.Request(names=["use_sim_time", "queue_depth"])
        service = f"robot/{hand}/tactile_filter/get_parameters"
        simulated, depth = probe.call(GetParameters, service, request).values
        return [simulated.bool_value, depth.integer_value]

    assert values("left") == [True, 1000]
    assert values("right") == [False, 1000]

    def subscribed(topic: str) -> list[str]:
        return [info.node_namespace for info in probe.node.get_subscriptions_info_by_topic(topic)]

    probe.until(lambda: subscribed("/robot/right/strain"), "both filters")
    probe.until(lambda: subscribed("/left_hand/strain"), "both filters")
    assert subscribed("/left_arm/pose") == ["/robot/left"]
    assert subscribed("/right_arm/pose") == ["/robot/right"]


def test_the_lifecycle_manager_example_is_read() -> None:
    example = ROOT / "examples/lifecycle_manager/managed_bringup.launch.py"
    entities = PythonLaunchDescriptionSource(str(example)).get_launch_description(LaunchContext()).entities
    assert [type(one) for one in entities] == [DeclareLaunchArgument, IncludeLaunchDescription, Node]
