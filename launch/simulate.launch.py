"""Without hardware: simulated hand, driver on its CAN bus, and mapping or filter.

ros2 launch tactile_localizer simulate.launch.py mode:=scan scan_file:=bump_scan
ros2 launch tactile_localizer simulate.launch.py mode:=localize scan_file:=bump_scan
"""

from launch.substitutions import EqualsSubstitution, IfElseSubstitution, LaunchConfiguration

from launch import LaunchDescription
from tactile_localizer.ros.launching import NODE, arguments, nodes

DEFAULTS = {"params_file": "simulator.yaml", "scene_file": "bump.yaml"}


def generate_launch_description():
    """Simulator, and what a robot starts."""
    is_scan = EqualsSubstitution(LaunchConfiguration("mode"), "scan")
    return LaunchDescription(
        [
            *arguments("mode", "scan_file", "scene_file", *NODE, **DEFAULTS),
            nodes("simulator", "driver", IfElseSubstitution(is_scan, "mapping", "filter")),
        ]
    )
