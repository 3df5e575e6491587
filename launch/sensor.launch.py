"""The source of strain: the driver of the load cells, or the adapter of another tactile sensor.

ros2 launch tactile_localizer sensor.launch.py channel:=can0
ros2 launch tactile_localizer sensor.launch.py sensor:=adapter adapter_file:=wrench.yaml
"""

from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import EqualsSubstitution, LaunchConfiguration

from launch import LaunchDescription
from tactile_localizer.ros import adapter_node, launching
from tactile_localizer.ros.driver_parameters import PARAMETERS as DRIVER


def generate_launch_description():
    """Driver or adapter."""
    buses = ("interface", "channel", "bus_options", "dbc", "phalanges")
    return LaunchDescription(
        [
            *launching.COMMON,
            DeclareLaunchArgument(
                "sensor",
                default_value="driver",
                choices=("driver", "adapter"),
                description="Source of strain: load cells on a CAN bus, or messages of another sensor",
            ),
            *launching.node(
                "driver",
                DRIVER,
                buses,
                IfCondition(EqualsSubstitution(LaunchConfiguration("sensor"), "driver")),
            ),
            *launching.node(
                "adapter",
                adapter_node.PARAMETERS,
                ("adapter_file",),
                IfCondition(EqualsSubstitution(LaunchConfiguration("sensor"), "adapter")),
            ),
        ]
    )
