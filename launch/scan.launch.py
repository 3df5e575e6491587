"""Recording of a training scan on a robot: driver (or adapter) and mapping.

ros2 launch tactile_localizer scan.launch.py scan_file:=bump_scan scene_file:=scene.yaml
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration

from launch import LaunchDescription
from tactile_localizer.ros.launching import NODE, nodes, shared_arguments


def generate_launch_description():
    """Sensor and mapping."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("scan_file", description="Scan (folder) to record, or to continue"),
            DeclareLaunchArgument("scene_file", description="Scene (YAML): axes and phalanges"),
            *shared_arguments("sensor", "pose_topic", *NODE),
            nodes(LaunchConfiguration("sensor"), "mapping"),
        ]
    )
