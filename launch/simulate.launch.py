"""Without hardware: simulated hand, driver on its CAN bus, and mapping or filter.

    ros2 launch tactile_localizer simulate.launch.py mode:=scan scan_file:=bump_scan scene_file:=bump.yaml
    ros2 launch tactile_localizer simulate.launch.py mode:=localize scan_file:=bump_scan

For a second hand on the same machine use another port: bus_options:="['port=43114']".
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.substitutions import EqualsSubstitution, LaunchConfiguration

from launch import LaunchDescription
from tactile_localizer.ros import launching
from tactile_localizer.ros.simulator_node import PARAMETERS

FILES = {"": "sensor", "scan": "scan", "localize": "bringup"}
"""Launch file beside the simulator, by mode."""


def generate_launch_description():
    """Simulator and driver on a bus over UDP, with mapping or filter as selected by the mode."""
    folder = Path(__file__).parent
    included = [
        IncludeLaunchDescription(
            str(folder / f"{file}.launch.py"),
            condition=IfCondition(EqualsSubstitution(LaunchConfiguration("mode"), mode)),
        )
        for mode, file in FILES.items()
    ]
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "mode",
                default_value="",
                choices=list(FILES),
                description="scan: training sweeps and the mapping; localize: sweeps from unknown positions "
                "and the filter; empty: training sweeps only",
            ),
            DeclareLaunchArgument(
                "interface", default_value="udp_multicast", description="python-can interface of the CAN bus"
            ),
            DeclareLaunchArgument(
                "channel", default_value="239.74.163.2", description="Channel of the interface"
            ),
            *launching.COMMON,
            *launching.node(
                "simulator", PARAMETERS, ("interface", "channel", "bus_options", "feature", "speed", "mode")
            ),
            *included,
        ]
    )
