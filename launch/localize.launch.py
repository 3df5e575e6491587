"""Localization beside a running sensor: the filter alone.

ros2 launch tactile_localizer localize.launch.py scan_file:=bump_scan
"""

from launch import LaunchDescription
from tactile_localizer.ros import launching
from tactile_localizer.ros.filter_parameters import PARAMETERS

ARGUMENTS = (
    "scan_file",
    "scene_file",
    "scan_directory",
    "pose_source",
    "palm_frame",
    "reference_frame",
    "material_frame",
    "patience_s",
    "publish_tf",
)


def generate_launch_description():
    """The filter."""
    return LaunchDescription([*launching.COMMON, *launching.node("filter", PARAMETERS, ARGUMENTS)])
