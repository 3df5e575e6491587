"""Replay of a bag: plays the topics of the filter once it is active.

Only ``replay.launch.py`` imports this module; it needs ``launch_ros`` from a ROS 2 distribution.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from launch.actions import (
    EmitEvent,
    ExecuteProcess,
    OpaqueFunction,
    RegisterEventHandler,
    Shutdown,
    TimerAction,
)
from launch.events import matches_action
from launch.events.process import ProcessExited
from launch.substitutions import FindExecutable
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from launch_ros.ros_adapters import get_ros_node
from lifecycle_msgs.msg import Transition

from launch import LaunchContext
from tactile_localizer.errors import ParameterError, TactileLocalizerError
from tactile_localizer.msg import Posterior
from tactile_localizer.ros.launching.arguments import Argument, positive, switch
from tactile_localizer.ros.launching.nodes import FILTER, POSE_TOPIC, resolved

_CLOCK_HZ = 200
"""Rate of ``/clock``, Hz; the default of 40 Hz is too coarse for strain at 100 Hz and more."""

_DISCOVERY_S = 3.0
"""Time for discovery, s, because ``ros2 bag play`` does not wait for subscribers; 2 s were too short on two
cores at a load of 8."""

_QUIET_S = 1.0
"""Time without a posterior after which the filter has processed all messages, s."""


def _bag(text: str) -> str:
    if not Path(text).exists():
        raise ParameterError("an existing bag")
    return text


BAG = Argument("bag", "Bag to play", None, _bag)
RATE = Argument("rate", "Speed relative to the recording", "1.0", positive)
LOOP = switch("loop", "Restart at the end of the bag", "false")
ARGUMENTS = (BAG, RATE, LOOP)

FILTER_ON_BAG_TIME = replace(
    FILTER,
    fixed={"use_sim_time": True, "autostart": False},
    queues={"strain": 10_000, POSE_TOPIC: 10_000},
)
"""The filter in the time of the bag, activated by the replay, with queues for fast playback."""


class Replay:
    """Activates the filter, plays the bag, and ends the launch when the filter has processed it.

    Parameters
    ----------
    context : context of the launch
    filter_node : action that starts the filter
    """

    def __init__(self, context: LaunchContext, filter_node: LifecycleNode) -> None:
        self._filter = filter_node
        self._posteriors = 0
        inputs = ("strain", POSE_TOPIC, "filter/initial_pose")
        self._topics = [*(resolved(topic, context) for topic in inputs), "/tf", "/tf_static"]
        self._bag, self._rate, self._loop = (argument.value(context) for argument in ARGUMENTS)
        topic = resolved("filter/posterior", context)
        get_ros_node(context).create_subscription(Posterior, topic, self._count, 1000)

    def actions(self) -> list[Any]:
        """The actions of the launch, in order."""
        return [
            self._on("configuring", "inactive", self._change(Transition.TRANSITION_ACTIVATE)),
            self._on("configuring", "unconfigured", OpaqueFunction(function=_fail_rejected)),
            self._on("activating", "active", self._player()),
            self._change(Transition.TRANSITION_CONFIGURE),
        ]

    def _count(self, message: Posterior) -> None:
        self._posteriors += 1

    def _on(self, start: str, goal: str, action: Any) -> RegisterEventHandler:
        handler = OnStateTransition(
            target_lifecycle_node=self._filter, start_state=start, goal_state=goal, entities=[action]
        )
        return RegisterEventHandler(handler)

    def _change(self, transition: int) -> EmitEvent:
        return EmitEvent(
            event=ChangeState(lifecycle_node_matcher=matches_action(self._filter), transition_id=transition)
        )

    def _player(self) -> ExecuteProcess:
        command = [FindExecutable(name="ros2"), "bag", "play", self._bag, "--clock", str(_CLOCK_HZ)]
        command += [
            "--rate",
            str(self._rate),
            "--delay",
            str(_DISCOVERY_S),
            *(["--loop"] if self._loop else []),
        ]
        return ExecuteProcess(
            cmd=[*command, "--topics", *self._topics], output="screen", on_exit=self._on_player_exit
        )

    def _on_player_exit(self, event: ProcessExited, context: LaunchContext) -> TimerAction | None:
        if context.is_shutdown:
            return None
        if event.returncode:
            raise TactileLocalizerError(f"ros2 bag play ended with status {event.returncode}")
        return self._once_quiet(before=-1)

    def _once_quiet(self, before: int) -> TimerAction | Shutdown:
        if self._posteriors > before:
            later = OpaqueFunction(function=lambda context, n: [self._once_quiet(n)], args=[self._posteriors])
            return TimerAction(period=_QUIET_S, actions=[later])
        if not self._posteriors:
            raise TactileLocalizerError(
                f"{self._bag}: expected valid messages on {' and '.join(self._topics[:2])}, "
                "the filter published no posterior"
            )
        return Shutdown(reason=f"the bag has ended: {self._posteriors} posteriors")


def _fail_rejected(context: LaunchContext) -> None:
    raise TactileLocalizerError("filter: expected a valid configuration, it was rejected")
