"""The scenarios of the launch files with plain processes: same nodes, parameters, namespaces, remappings."""

from __future__ import annotations

import os
import time
from pathlib import Path
from signal import SIGINT, SIGKILL, Signals
from typing import Any

import pytest
from support.scenarios import SCENARIOS, Place, Scenario, ros2_bag
from support.waiting import children, has_ended, wait_until

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


@pytest.mark.parametrize("how", [SIGINT, SIGKILL])
def test_a_replay_that_ends_leaves_no_player(how: Signals, place: Place, process: Any) -> None:
    """Ctrl-C reaches a launched node twice: from the terminal, and from launch."""
    scenario = next(one for one in SCENARIOS if one.name == "looping bag")
    environment = {"PATH": f"{Path(ros2_bag()).parent}{os.pathsep}{os.environ['PATH']}"}
    filter_node, replay = (process(command, environment) for command in scenario.started(place)[0].commands())
    (player,) = wait_until(lambda: children(replay.pid), "the player", 60.0)
    while replay.running:
        os.kill(replay.pid, how)
        time.sleep(0.005)
    assert replay.wait() == (0 if how is SIGINT else -SIGKILL), replay.output
    wait_until(lambda: has_ended(player), "the end of the player")
    assert filter_node.stop() == 0
