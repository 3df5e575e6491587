"""The source of strain: the driver of the load cells, or the adapter of another tactile sensor.

ros2 launch tactile_localizer sensor.launch.py params_file:=hand.yaml
"""

from pathlib import Path

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode
from launch_ros.parameter_descriptions import ParameterFile

from launch import LaunchDescription


def generate_launch_description():
    """Driver or adapter."""
    shipped = str(Path(__file__).parents[1] / "config" / "robot.yaml")
    sensor, sensors = LaunchConfiguration("sensor"), ["driver", "adapter"]
    return LaunchDescription(
        [
            DeclareLaunchArgument("sensor", default_value="driver", choices=sensors, description="Its node"),
            DeclareLaunchArgument("namespace", default_value="", description="Of the node"),
            DeclareLaunchArgument("params_file", default_value=shipped, description="Parameter file"),
            LifecycleNode(
                package="tactile_localizer",
                executable=[sensor, "_node"],
                name=["tactile_", sensor],
                namespace=LaunchConfiguration("namespace"),
                parameters=[ParameterFile(LaunchConfiguration("params_file"))],
            ),
        ]
    )
