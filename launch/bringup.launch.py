"""Localization on a robot: driver and filter.

ros2 launch tactile_localizer bringup.launch.py scan_file:=scan.db namespace:=left
"""

from tactile_localizer.ros.launching.nodes import DRIVER, FILTER, nodes


def generate_launch_description():
    """Driver and filter."""
    return nodes(DRIVER, FILTER)
