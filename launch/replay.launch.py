"""Replay of a bag through the filter, in the time of the bag.

    ros2 launch tactile_localizer replay.launch.py bag:=bag scan_file:=bump_scan rate:=2.0

`tactile-localizer replay` does the same without ROS, as fast as possible, and prints figures.
"""

from pathlib import Path

from launch.event_handlers import OnProcessExit
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import SetParameter

from launch import LaunchDescription, actions

WITHOUT = (
    ".*/tactile_filter/(posterior|pose|converged|particles|markers|map|transition_event)|/diagnostics|/clock"
)
"""Topics of the bag that would be published twice."""


def generate_launch_description():
    """The filter in simulated time, and the bag once it is active."""
    bag, rate = LaunchConfiguration("bag"), LaunchConfiguration("rate")
    localize = str(Path(__file__).with_name("localize.launch.py"))
    files = {"scan_file": LaunchConfiguration("scan_file")}
    # An active filter publishes every second. The event of its transition is not waited for: it is lost if
    # the filter is active before launch is discovered.
    topic = [LaunchConfiguration("namespace"), "/tactile_filter/posterior"]
    echo = ["ros2", "topic", "echo", "--once", "--no-daemon", topic, "tactile_localizer/msg/Posterior"]
    # The player does not wait for subscribers; its default of 40 Hz is coarse for the clock of a filter.
    command = ["ros2", "bag", "play", bag, "--clock", "200", "--rate", rate, "--delay", "3"]
    play = actions.ExecuteProcess(cmd=[*command, "--exclude-regex", WITHOUT])
    active = actions.ExecuteProcess(cmd=echo)

    def on_exit(event, context):
        return None if context.is_shutdown else play if event.action is active else actions.Shutdown()

    return LaunchDescription(
        [
            actions.DeclareLaunchArgument("bag", description="Bag to play"),
            actions.DeclareLaunchArgument("rate", default_value="1.0", description="Speed of the replay"),
            SetParameter("use_sim_time", True),
            SetParameter("queue_depth", 10_000),
            SetParameter("patience_s", 60.0),  # a pose that is 0.1 s late is 1 s late by its stamp at rate 10
            actions.IncludeLaunchDescription(localize, launch_arguments=files.items()),
            actions.RegisterEventHandler(OnProcessExit(on_exit=on_exit)),
            active,
        ]
    )
