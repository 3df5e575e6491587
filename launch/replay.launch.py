"""Replay of a bag through the filter, in the time of the bag.

    ros2 launch tactile_localizer replay.launch.py bag:=bag scan_file:=bump_scan rate:=2.0

Ends with the bag; with status 1 if it could not be played, or gave no posterior. `tactile-localizer replay`
does the same without ROS, as fast as possible, and prints figures.
"""

from launch.event_handlers import OnProcessExit
from launch.substitutions import LaunchConfiguration
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from lifecycle_msgs.msg import Transition

from launch import LaunchDescription, actions
from tactile_localizer.ros.launching import arguments, failure, nodes

WITHOUT = (
    ".*/tactile_filter/(posterior|pose|converged|particles|markers|map|transition_event)|/diagnostics|/clock"
)
"""Topics of the bag that would be published twice; POSIX extended (sqlite3) and ECMAScript (MCAP) alike."""

PARAMETERS = {
    "use_sim_time": True,
    "queue_depth": 10_000,
    "patience_s": 60.0,  # a pose that is 0.1 s late is 1 s late by its stamp at rate 10
}

DEACTIVATE = ChangeState(
    lifecycle_node_matcher=lambda node: True, transition_id=Transition.TRANSITION_DEACTIVATE
)
"""Lets the filter process what has arrived: on a busy machine it is behind the bag."""

LAST_S = 3.0
"""Time after the end of the bag for the first posterior, if there was none, s."""


def generate_launch_description():
    """The filter in simulated time, and the bag once it is active."""
    bag, rate = LaunchConfiguration("bag"), LaunchConfiguration("rate")
    # An active filter publishes every second, as stale while it has no strain. The event of its transition is
    # not waited for: it is lost if the filter is active before launch is discovered.
    topic = [LaunchConfiguration("namespace"), "/tactile_filter/posterior"]
    echo = ["ros2", "topic", "echo", "--once", "--no-daemon", topic, "tactile_localizer/msg/Posterior"]
    active = actions.ExecuteProcess(cmd=echo)
    localized = actions.ExecuteProcess(cmd=[*echo, "--filter", "not m.stale"])
    # The player does not wait for subscribers; its default of 40 Hz is coarse for the clock of a filter.
    command = ["ros2", "bag", "play", bag, "--clock", "200", "--rate", rate, "--delay", "3"]
    play = actions.ExecuteProcess(cmd=[*command, "--exclude-regex", WITHOUT])

    is_drained = False

    def on_exit(event, context):
        if context.is_shutdown:
            return None
        if event.returncode or event.action not in (active, play, localized):
            return failure(f"replay: {event.process_name} ended with status {event.returncode}")
        if event.action is active:
            return play
        if event.action is play:
            return actions.EmitEvent(event=DEACTIVATE)
        return actions.Shutdown() if is_drained else None

    def on_inactive(context):
        nonlocal is_drained
        is_drained = True
        if localized.return_code is None:
            return [failure(f"{bag.perform(context)}: expected posteriors, found none", LAST_S)]
        return [actions.Shutdown()]

    drained = actions.OpaqueFunction(function=on_inactive)
    return LaunchDescription(
        [
            *arguments("bag", "scan_file", "rate", "pose_topic", "namespace", "params_file"),
            nodes("filter", **PARAMETERS),
            actions.RegisterEventHandler(OnProcessExit(on_exit=on_exit)),
            actions.RegisterEventHandler(OnStateTransition(start_state="deactivating", entities=[drained])),
            active,
            localized,
        ]
    )
