"""Recording of a training scan on a robot: driver and mapping.

ros2 launch tactile_localizer scan.launch.py scan_file:=scan.db scene_file:=scene.yaml
"""

from tactile_localizer.ros.launching.nodes import DRIVER, MAPPING, nodes


def generate_launch_description():
    """Driver and mapping."""
    return nodes(DRIVER, MAPPING)
