"""Localization on a robot: driver (or adapter) and filter.

ros2 launch tactile_localizer bringup.launch.py scan_file:=bump_scan namespace:=left
"""

from launch.substitutions import LaunchConfiguration

from launch import LaunchDescription
from tactile_localizer.ros.launching import NODE, arguments, nodes


def generate_launch_description():
    """Sensor and filter."""
    return LaunchDescription(
        [
            *arguments("scan_file", "sensor", "pose_topic", *NODE),
            nodes(LaunchConfiguration("sensor"), "filter"),
        ]
    )
