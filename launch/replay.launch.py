"""A recorded bag through the live filter, in the bag's time.

    ros2 launch tactile_localizer replay.launch.py bag:=bag scan_file:=scan.db rate:=2.0 loop:=true

`tactile-localizer replay` does the same without ROS, as fast as the machine goes.
"""

from dataclasses import replace

from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, Shutdown
from launch.substitutions import FindExecutable, LaunchConfiguration

from tactile_localizer.nodes.launching import FILTER, nodes

_CLOCK_HZ = "200"  # the default of 40 Hz is coarse for what happens in milliseconds


def generate_launch_description():
    """The filter on simulated time, and the bag that gives it."""
    description = nodes(replace(FILTER, fixed={"use_sim_time": True}))
    for name, default, text in (
        ("bag", None, "Bag to play"),
        ("rate", "1.0", "How many times as fast as it was recorded"),
        ("loop", "false", "Begin again at the bag's end"),
    ):
        description.add_action(DeclareLaunchArgument(name, default_value=default, description=text))
    description.add_action(OpaqueFunction(function=_play))
    return description


def _play(context):
    bag, rate, loop = (LaunchConfiguration(name).perform(context) for name in ("bag", "rate", "loop"))
    command = [FindExecutable(name="ros2"), "bag", "play", bag, "--clock", _CLOCK_HZ, "--rate", rate]
    if loop.lower() == "true":
        command.append("--loop")
    return [ExecuteProcess(cmd=command, output="screen", on_exit=Shutdown(reason="the bag has ended"))]
