"""Replay of a bag through the live filter, in the time of the bag.

    ros2 launch tactile_localizer replay.launch.py bag:=bag scan_file:=bump_scan rate:=2.0 loop:=true

`tactile-localizer replay` does the same without ROS, as fast as possible.
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration, PythonExpression

from launch import LaunchDescription
from tactile_localizer.ros import launching
from tactile_localizer.ros.replay_node import PARAMETERS


def generate_launch_description():
    """The filter in simulated time; once it is active, the bag."""
    rate, loop = LaunchConfiguration("rate"), LaunchConfiguration("loop")
    # A pose may be late by the patience divided by the rate; a loop must be longer than twice the patience.
    patience = PythonExpression(["max(1.0, float('", rate, "')) if '", loop, "'.lower() == 'true' else 60.0"])
    filter_arguments = {"use_sim_time": "true", "autostart": "true", "queue_depth": "10000"}
    return LaunchDescription(
        [
            *launching.COMMON,
            DeclareLaunchArgument("rate", default_value="1.0", description="Speed relative to the recording"),
            *launching.node("replay", PARAMETERS, ("bag", "rate", "loop")),
            DeclareLaunchArgument(
                "patience_s",
                default_value=patience,
                description="Time, measured in stamps, that a strain vector waits for a late pose [s]",
            ),
            IncludeLaunchDescription(
                str(Path(__file__).with_name("localize.launch.py")), launch_arguments=filter_arguments.items()
            ),
        ]
    )
