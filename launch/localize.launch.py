"""Localization beside a running driver: the filter alone.

ros2 launch tactile_localizer localize.launch.py scan_file:=scan.db
"""

from tactile_localizer.ros.launching.nodes import FILTER, nodes


def generate_launch_description():
    """The filter."""
    return nodes(FILTER)
