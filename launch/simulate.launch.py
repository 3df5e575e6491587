"""Without hardware: simulated hand, driver on its CAN bus, and mapping or filter.

ros2 launch tactile_localizer simulate.launch.py mode:=scan scan_file:=bump_scan
ros2 launch tactile_localizer simulate.launch.py mode:=localize scan_file:=bump_scan
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import EqualsSubstitution, IfElseSubstitution, LaunchConfiguration

from launch import LaunchDescription
from tactile_localizer.ros.launching import NODE, nodes, shared_arguments


def generate_launch_description():
    """Simulator, and what a robot starts."""
    is_scan = EqualsSubstitution(LaunchConfiguration("mode"), "scan")
    return LaunchDescription(
        [
            DeclareLaunchArgument("mode", choices=["scan", "localize"], description="Mapping or filter"),
            DeclareLaunchArgument("scan_file", description="Scan (folder) to record, or that is the map"),
            DeclareLaunchArgument("scene_file", default_value="bump.yaml", description="Scene to record"),
            *shared_arguments(*NODE, params_file="simulator.yaml"),
            nodes("simulator", "driver", IfElseSubstitution(is_scan, "mapping", "filter")),
        ]
    )
