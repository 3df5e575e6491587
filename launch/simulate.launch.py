"""Without hardware: simulated hand, driver on its CAN bus, and mapping or filter.

ros2 launch tactile_localizer simulate.launch.py mode:=scan scan_file:=bump_scan
ros2 launch tactile_localizer simulate.launch.py mode:=localize scan_file:=bump_scan
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.substitutions import EqualsSubstitution, IfElseSubstitution, LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterFile

from launch import LaunchDescription


def generate_launch_description():
    """Simulator, and what a robot starts."""
    shipped = str(Path(__file__).parents[1] / "config" / "simulator.yaml")
    given = {name: LaunchConfiguration(name) for name in ("mode", "scan_file", "scene_file")}
    name = IfElseSubstitution(EqualsSubstitution(given["mode"], "scan"), "scan", "bringup")
    file = [str(Path(__file__).parent), "/", name, ".launch.py"]
    arguments = [
        DeclareLaunchArgument("mode", choices=["scan", "localize"], description="Mapping or filter"),
        DeclareLaunchArgument("scan_file", description="Scan (folder) to record, or that is the map"),
        DeclareLaunchArgument("scene_file", default_value="bump.yaml", description="Scene to record"),
        DeclareLaunchArgument("params_file", default_value=shipped, description="Parameter file"),
    ]
    simulator = Node(
        package="tactile_localizer",
        executable="simulator_node",
        namespace=LaunchConfiguration("namespace"),
        parameters=[ParameterFile(LaunchConfiguration("params_file")), {"mode": given["mode"]}],
    )
    beside = IncludeLaunchDescription(file, launch_arguments=given.items())
    return LaunchDescription([*arguments, beside, simulator])
