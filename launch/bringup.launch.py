"""Localization on a robot: driver (or adapter) and filter.

ros2 launch tactile_localizer bringup.launch.py scan_file:=bump_scan namespace:=left
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration

from launch import LaunchDescription
from tactile_localizer.ros.launching import NODE, nodes, shared_arguments


def generate_launch_description():
    """Sensor and filter."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("scan_file", description="Scan (folder) that is the map"),
            *shared_arguments("sensor", "pose_topic", *NODE),
            nodes(LaunchConfiguration("sensor"), "filter"),
        ]
    )
