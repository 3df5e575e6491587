"""The filter, beside a running sensor.

ros2 launch tactile_localizer localize.launch.py scan_file:=bump_scan
"""

from launch.actions import DeclareLaunchArgument

from launch import LaunchDescription
from tactile_localizer.ros.launching import NODE, nodes, shared_arguments


def generate_launch_description():
    """The filter."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("scan_file", description="Scan (folder) that is the map"),
            *shared_arguments("pose_topic", *NODE),
            nodes("filter"),
        ]
    )
