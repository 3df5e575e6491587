"""The scenarios with real launch files, namespaces and remappings."""

from pathlib import Path
from typing import Any

import pytest
from support.probe import Probe
from support.processes import Process
from support.scenarios import SCENARIOS, Place, Scenario

launch_pytest = pytest.importorskip(
    "launch_pytest", reason="launch_pytest is not installed: only a ROS 2 distribution has it"
)

from launch.actions import IncludeLaunchDescription  # noqa: E402
from launch.launch_description_sources import PythonLaunchDescriptionSource  # noqa: E402
from launch_pytest.actions import ReadyToTest  # noqa: E402

from launch import LaunchDescription  # noqa: E402

pytestmark = pytest.mark.ros

FOLDER = Path(__file__).parents[2] / "launch"


@launch_pytest.fixture(params=SCENARIOS, ids=lambda scenario: scenario.name)
def launched(request: Any, place: Place, process: Any, monkeypatch: Any) -> Any:
    """Start the launch files of a scenario, and substitutes for hardware as processes."""
    monkeypatch.setenv("ROS_HOME", str(place.folder))
    scenario: Scenario = request.param
    actions = []
    for started in scenario.started(place):
        if started.launch_file:
            source = PythonLaunchDescriptionSource(str(FOLDER / started.launch_file))
            arguments = started.launch_arguments(place.folder)
            actions.append(IncludeLaunchDescription(source, launch_arguments=arguments))
        else:
            for command in started.commands(place.folder):
                hardware: Process = process(command)
                assert hardware.running
    return LaunchDescription([*actions, ReadyToTest()]), scenario


@pytest.mark.launch(fixture=launched)
def test_scenario_of_a_launch(launched: Any, place: Place, probe: Probe) -> None:
    launched[1].check(probe, place)
