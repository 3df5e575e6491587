"""The filter, beside a running sensor.

ros2 launch tactile_localizer localize.launch.py scan_file:=bump_scan
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode
from launch_ros.parameter_descriptions import ParameterFile

from launch import LaunchDescription


def generate_launch_description():
    """The filter."""
    shipped = str(Path(__file__).parents[1] / "config" / "robot.yaml")
    files = {"scan_file": LaunchConfiguration("scan_file")}
    return LaunchDescription(
        [
            DeclareLaunchArgument("scan_file", description="Scan (folder) that is the map"),
            DeclareLaunchArgument("pose_topic", default_value="palm_pose", description="Topic of the poses"),
            DeclareLaunchArgument("namespace", default_value="", description="Of the node"),
            DeclareLaunchArgument("params_file", default_value=shipped, description="Parameter file"),
            LifecycleNode(
                package="tactile_localizer",
                executable="filter_node",
                name="tactile_filter",
                namespace=LaunchConfiguration("namespace"),
                parameters=[ParameterFile(LaunchConfiguration("params_file")), files],
                remappings=[("palm_pose", LaunchConfiguration("pose_topic"))],
            ),
        ]
    )
