"""The source of strain: the driver of the load cells, or the adapter of another tactile sensor.

ros2 launch tactile_localizer sensor.launch.py params_file:=hand.yaml
"""

from launch.substitutions import LaunchConfiguration

from launch import LaunchDescription
from tactile_localizer.ros.launching import NODE, arguments, nodes


def generate_launch_description():
    """Driver or adapter."""
    return LaunchDescription([*arguments("sensor", *NODE), nodes(LaunchConfiguration("sensor"))])
