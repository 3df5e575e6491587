"""Driver and filter led by Nav2's lifecycle manager.

ros2 launch managed_bringup.launch.py scan_file:=bump_scan
"""

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description():
    """Nodes that wait for the manager, and the manager."""
    bringup = [FindPackageShare("tactile_localizer"), "/launch/bringup.launch.py"]
    given = {"scan_file": LaunchConfiguration("scan_file"), "autostart": "false"}
    manager = Node(
        package="nav2_lifecycle_manager",
        executable="lifecycle_manager",
        name="lifecycle_manager_touch",
        parameters=[
            {
                "node_names": [
                    "tactile_driver",
                    "tactile_filter",
                ],  # in the order in which they are brought up
                "autostart": True,
                "bond_timeout": 0.0,  # the nodes offer no bond; launch sees a process that ends
            }
        ],
        output="screen",
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument("scan_file", description="Scan (folder) that is the map"),
            IncludeLaunchDescription(bringup, launch_arguments=given.items()),
            manager,
        ]
    )
