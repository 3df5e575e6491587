"""Without hardware: simulated hand, driver on its CAN bus, and mapping or filter.

    ros2 launch tactile_localizer simulate.launch.py mode:=scan scan_file:=scan.db scene_file:=bump.yaml
    ros2 launch tactile_localizer simulate.launch.py mode:=localize scan_file:=scan.db

For a second hand on the same machine use another port: bus_options:="['port=43114']".
"""

from dataclasses import replace

from tactile_localizer.ros.launching.nodes import BUS, DRIVER, FILTER, MAPPING, SIMULATOR, nodes

_SIMULATED = {"interface": "udp_multicast", "channel": "239.74.163.2"}


def generate_launch_description():
    """Simulator and driver on a bus over UDP, with mapping or filter as selected by the mode."""
    bus = tuple(replace(argument, default=_SIMULATED.get(argument.name, "")) for argument in BUS)
    return nodes(
        replace(SIMULATOR, arguments=(*bus, *SIMULATOR.arguments[len(BUS) :])),
        replace(DRIVER, arguments=(*bus, *DRIVER.arguments[len(BUS) :])),
        replace(MAPPING, when=("mode", "scan")),
        replace(FILTER, when=("mode", "localize")),
    )
