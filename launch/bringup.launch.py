"""Localization on a robot: driver (or adapter) and filter.

ros2 launch tactile_localizer bringup.launch.py scan_file:=bump_scan namespace:=left
"""

from pathlib import Path

from launch.actions import IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration

from launch import LaunchDescription


def generate_launch_description():
    """Sensor and filter."""
    folder, files = Path(__file__).parent, {"scan_file": LaunchConfiguration("scan_file")}
    return LaunchDescription(
        [
            IncludeLaunchDescription(str(folder / "sensor.launch.py")),
            IncludeLaunchDescription(str(folder / "localize.launch.py"), launch_arguments=files.items()),
        ]
    )
