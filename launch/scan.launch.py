"""Recording of a training scan on a robot: driver (or adapter) and mapping.

ros2 launch tactile_localizer scan.launch.py scan_file:=bump_scan scene_file:=scene.yaml
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode
from launch_ros.parameter_descriptions import ParameterFile

from launch import LaunchDescription


def generate_launch_description():
    """Sensor and mapping."""
    files = {name: LaunchConfiguration(name) for name in ("scan_file", "scene_file")}
    return LaunchDescription(
        [
            DeclareLaunchArgument("scan_file", description="Scan (folder) to record, or to continue"),
            DeclareLaunchArgument("scene_file", description="Scene (YAML): axes and phalanges"),
            DeclareLaunchArgument("pose_topic", default_value="palm_pose", description="Topic of the poses"),
            IncludeLaunchDescription(str(Path(__file__).with_name("sensor.launch.py"))),
            LifecycleNode(
                package="tactile_localizer",
                executable="mapping_node",
                name="tactile_mapping",
                namespace=LaunchConfiguration("namespace"),
                parameters=[ParameterFile(LaunchConfiguration("params_file")), files],
                remappings=[("palm_pose", LaunchConfiguration("pose_topic"))],
            ),
        ]
    )
