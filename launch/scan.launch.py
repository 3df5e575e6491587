"""Recording of a training scan on a robot: driver (or adapter) and mapping.

ros2 launch tactile_localizer scan.launch.py scan_file:=bump_scan scene_file:=scene.yaml
"""

from launch.substitutions import LaunchConfiguration

from launch import LaunchDescription
from tactile_localizer.ros.launching import NODE, arguments, nodes


def generate_launch_description():
    """Sensor and mapping."""
    return LaunchDescription(
        [
            *arguments("scan_file", "scene_file", "sensor", "pose_topic", *NODE),
            nodes(LaunchConfiguration("sensor"), "mapping"),
        ]
    )
