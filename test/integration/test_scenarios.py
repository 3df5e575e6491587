"""The scenarios of the launch files with plain processes: same nodes, parameters, namespaces, remappings."""

from __future__ import annotations

from typing import Any

import pytest
from support.scenarios import SCENARIOS, Place, Scenario

pytestmark = pytest.mark.ros


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda scenario: scenario.name)
def test_scenario_of_processes(scenario: Scenario, place: Place, process: Any, probe: Any) -> None:
    running = [
        process(command, {"ROS_HOME": str(place.folder)})
        for started in scenario.started(place)
        for command in started.commands(place.folder)
    ]
    try:
        scenario.check(probe, place)
    except AssertionError as error:
        raise type(error)(f"{error}\n" + "\n".join(one.output for one in running)) from error
    for one in running:
        assert one.stop() == 0, one.output
        assert "Traceback" not in one.output
