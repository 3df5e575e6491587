"""The filter, beside a running sensor.

ros2 launch tactile_localizer localize.launch.py scan_file:=bump_scan
"""

from launch import LaunchDescription
from tactile_localizer.ros.launching import NODE, arguments, nodes


def generate_launch_description():
    """The filter."""
    return LaunchDescription(
        [
            *arguments("scan_file", "pose_topic", *NODE),
            nodes("filter"),
        ]
    )
