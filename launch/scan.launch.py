"""Recording of a training scan on a robot: driver (or adapter) and mapping.

ros2 launch tactile_localizer scan.launch.py scan_file:=bump_scan scene_file:=scene.yaml
"""

from pathlib import Path

from launch.actions import IncludeLaunchDescription

from launch import LaunchDescription
from tactile_localizer.ros import launching
from tactile_localizer.ros.mapping_parameters import PARAMETERS

ARGUMENTS = ("scan_file", "scene_file", "pose_source", "palm_frame", "reference_frame", "material_frame")


def generate_launch_description():
    """Sensor and mapping."""
    return LaunchDescription(
        [
            IncludeLaunchDescription(str(Path(__file__).with_name("sensor.launch.py"))),
            *launching.node("mapping", PARAMETERS, ARGUMENTS),
        ]
    )
