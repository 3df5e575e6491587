"""The scenarios of the launch files with plain processes: same nodes, parameters, namespaces, remappings."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
from support.scenarios import SCENARIOS, Place, Scenario, ros2_bag

pytestmark = pytest.mark.ros


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda scenario: scenario.name)
def test_scenario_of_processes(scenario: Scenario, place: Place, process: Any, probe: Any) -> None:
    path = f"{Path(ros2_bag()).parent}{os.pathsep}{os.environ['PATH']}"
    running = [
        process(command, {"ROS_HOME": str(place.folder), "PATH": path})
        for started in scenario.started(place)
        for command in started.commands()
    ]
    try:
        scenario.check(probe, place)
    except AssertionError as error:
        raise type(error)(f"{error}\n" + "\n".join(one.output for one in running)) from error
    for one in running:
        assert one.stop() == 0, one.output
        assert "Traceback" not in one.output
