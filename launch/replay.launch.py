"""Replay of a bag through the filter, in the time of the bag.

    ros2 launch tactile_localizer replay.launch.py bag:=bag scan_file:=bump_scan rate:=2.0

Ends with the bag; with status 1 if it could not be played, or gave no posterior. `tactile-localizer replay`
does the same without ROS, as fast as possible, and prints figures.
"""

from launch.event_handlers import OnProcessExit
from launch.events import matches_action
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from launch_ros.ros_adapters import get_ros_node
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import GetState

from launch import LaunchDescription, actions
from tactile_localizer.ros.launching import arguments, failure, nodes

WITHOUT = (
    ".*/tactile_filter/(posterior|pose|converged|particles|markers|map|transition_event)|/diagnostics|/clock"
)
"""Topics of the bag that would be published twice; POSIX extended (sqlite3) and ECMAScript (MCAP) alike."""

PARAMETERS = {
    "use_sim_time": True,
    "autostart": True,
    "queue_depth": 10_000,
    "patience_s": 60.0,  # a pose that is 0.1 s late is 1 s late by its stamp at rate 10
}

LAST_S = 3.0
"""Time after the end of the bag for the first posterior, if there was none, s."""
ANSWER_S = 180.0
"""Time within which the filter has to answer, s: imports take half a minute on a busy machine."""
POLL_S = 0.5
"""Interval between questions for the state of the filter, s."""


def generate_launch_description():
    """The filter in simulated time, and the bag once it is active."""
    return LaunchDescription(
        [
            *arguments("bag", "scan_file", "rate", "pose_topic", "namespace", "params_file", "log_level"),
            nodes("filter", then=play, **PARAMETERS),
        ]
    )


def play(context, filter_node):
    """Actions that play the bag once the filter is active, and end with it."""
    given, environment = context.launch_configurations, dict(context.environment)
    bag, topic = given["bag"], f"{filter_node.node_name}/posterior"

    def command(*words):  # of the environment of this file: the player starts after that of a group has ended
        return actions.ExecuteProcess(cmd=["ros2", *words], env=environment)

    echo = "topic", "echo", "--once", "--no-daemon", topic, "tactile_localizer/msg/Posterior"
    localized = command(*echo, "--filter", "not m.stale")
    # The player does not wait for subscribers; its default of 40 Hz is coarse for the clock of a filter.
    player = command(
        *("bag", "play", bag, "--clock", "200", "--rate", given["rate"], "--delay", "3"),
        *("--exclude-regex", WITHOUT),
    )
    # It lets the filter process what has arrived: on a busy machine it is behind the bag.
    deactivate = ChangeState(
        lifecycle_node_matcher=matches_action(filter_node),
        transition_id=Transition.TRANSITION_DEACTIVATE,
    )
    is_drained = False

    def on_exit(event, context):
        if context.is_shutdown:
            return None
        if event.returncode or event.action is filter_node:
            return failure(f"replay: {event.process_name} ended with status {event.returncode}")
        if event.action is player:
            return actions.EmitEvent(event=deactivate)
        return actions.Shutdown() if is_drained else None

    def on_inactive(context):
        nonlocal is_drained
        is_drained = True
        if localized.return_code is None:
            return [failure(f"{bag}: expected posteriors on {topic}, found none", LAST_S)]
        return [actions.Shutdown()]

    drained = actions.OpaqueFunction(function=on_inactive)
    is_inactive = OnStateTransition(
        target_lifecycle_node=filter_node, start_state="deactivating", entities=[drained]
    )
    ends = [OnProcessExit(target_action=one, on_exit=on_exit) for one in (filter_node, localized, player)]
    return [
        *map(actions.RegisterEventHandler, (*ends, is_inactive)),
        localized,
        once_active(context, filter_node, player),
    ]


def once_active(context, node, action):
    """The action, once a lifecycle node is active. It is asked: the event of its transition may be lost."""
    client = get_ros_node(context).create_client(GetState, f"{node.node_name}/get_state")
    states = set()

    def ask(context, left_s):
        if State.PRIMARY_STATE_ACTIVE in states:
            return [action]
        if not states and left_s < 0.0:
            return [failure(f"{node.node_name}: expected an answer within {ANSWER_S:g} s, got none")]
        if client.service_is_ready():
            answer = client.call_async(GetState.Request())
            answer.add_done_callback(lambda answer: states.add(answer.result().current_state.id))
        again = actions.OpaqueFunction(function=ask, args=[left_s - POLL_S])
        return [actions.TimerAction(period=POLL_S, actions=[again])]

    return actions.OpaqueFunction(function=ask, args=[ANSWER_S])
