"""Replay of a bag through the live filter, in the time of the bag.

    ros2 launch tactile_localizer replay.launch.py bag:=bag scan_file:=scan.db rate:=2.0 loop:=true

`tactile-localizer replay` does the same without ROS, as fast as possible.
"""

from tactile_localizer.ros.launching.nodes import nodes
from tactile_localizer.ros.launching.replay import ARGUMENTS, FILTER_ON_BAG_TIME, Replay


def generate_launch_description():
    """The filter in simulated time; once it is active, the bag."""
    return nodes(
        FILTER_ON_BAG_TIME,
        arguments=ARGUMENTS,
        further=lambda context, started: Replay(context, *started).actions(),
    )
