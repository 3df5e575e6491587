"""Prints docs/parameters.md, from what the nodes themselves declare. `make docs` keeps it."""

from __future__ import annotations

import rclpy

from tactile_localizer.ros.adapter_node import AdapterNode
from tactile_localizer.ros.base.managed_node import ManagedNode
from tactile_localizer.ros.base.parameters import Parameter
from tactile_localizer.ros.driver_node import DriverNode
from tactile_localizer.ros.filter_node import FilterNode
from tactile_localizer.ros.mapping_node import MappingNode
from tactile_localizer.ros.simulator_node import SimulatorNode

HEAD = """\
# Parameters

`make docs` writes this page from the nodes' own descriptors; `ros2 param describe NODE NAME` shows
the same of a running node. Parameters marked *live* may be set at any time. The others are read
when a node configures and refused, with the reason, while it is configured. A value of the wrong
type or out of its range is refused too, and a name that the node does not have is ignored with a
warning. A list of strings without entries is `"['']"` on the command line, which cannot give `[]` a
type.

[essentials.md](essentials.md) has the five values that matter. Of the parameters below, those
marked **essential** have to fit your robot; all others are advanced, and their defaults serve.

The recommended values are in `config/*.yaml`; a launch argument of the same name overrides them.
The bounds of the material, its motion noise and the kernel widths are not parameters of a node but
part of the [scene](concepts.md#scene)."""

ESSENTIAL = {
    "phalanges", "dbc", "channel", "scan_file", "scene_file", "adapter_file",
    "material_frame", "reference_frame", "material_pose", "convergence_radius",
}  # fmt: skip
"""Parameters that no default can know: wiring, files, frames, and how precise a position has to be."""

NODES = {
    DriverNode: "Load cells on a CAN bus to `strain` ([can.md](can.md)).",
    MappingNode: "`strain` and `palm_pose` to a scan file ([scan.md](scan.md)).",
    FilterNode: "`strain` and `palm_pose` to a belief ([models.md](models.md)).",
    AdapterNode: "Messages of other sensors' drivers to `strain` ([sensors.md](sensors.md)).",
    SimulatorNode: "The simulated hand ([simulation.md](simulation.md)).",
}


def page() -> str:
    """The whole page."""
    rclpy.init()
    nodes = [kind() for kind in NODES]
    try:
        declared = [list(node.parameters) for node in nodes]
        titles = [title(node) for node in nodes]
    finally:
        for node in nodes:
            node.close()
            node.destroy_node()
        rclpy.shutdown()
    shared = [parameter for parameter in declared[0] if all(parameter in others for others in declared[1:])]
    parts = [HEAD, section("Every node", "Beside ROS's own `use_sim_time` and `qos_overrides`.", shared)]
    for heading, purpose, parameters in zip(titles, NODES.values(), declared, strict=True):
        own = [parameter for parameter in parameters if parameter not in shared]
        parts.append(section(heading, purpose, own))
    return "\n\n".join(parts)


def title(node: ManagedNode) -> str:
    """Executable and name of a node."""
    kind = type(node).__name__.removesuffix("Node").lower()
    return f"{kind}_node, called `{node.get_name()}`"


def section(heading: str, purpose: str, parameters: list[Parameter]) -> str:
    """One table."""
    lines = [f"## {heading}", "", purpose, "", "| parameter | default | allowed | |", "|---|---|---|---|"]
    for parameter in parameters:
        essential = " **Essential.**" if parameter.name in ESSENTIAL else ""
        live = " *Live.*" if parameter.live else ""
        unit = f" [{parameter.unit}]" if parameter.unit else ""
        text = f"{sentence(f'{parameter.description}{unit}')}{essential}{live}".replace("|", "\\|")
        lines.append(f"| `{parameter.name}` | {shown(parameter.default)} | {allowed(parameter)} | {text} |")
    return "\n".join(lines)


def sentence(text: str) -> str:
    """A description with the full stop that it has not."""
    return text if text.endswith((".", "?")) else f"{text}."


def shown(default: object) -> str:
    """A default as YAML has it."""
    if default in ("", []):
        return "none"
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    if isinstance(default, list):
        return f"`[{', '.join(map(str, default))}]`"
    return f"`{default:g}`" if isinstance(default, float) else f"`{default}`"


def allowed(parameter: Parameter) -> str:
    """Choices, range, or kind."""
    if parameter.choices:
        return ", ".join(f"`{choice}`" for choice in parameter.choices)
    lower, upper = parameter.lower, parameter.upper
    if lower is None and upper is None:
        kinds = {bool: "true or false", str: "text", list: "list"}
        return kinds.get(type(parameter.default), "number")
    assert lower is not None, f"{parameter.name}: a range without a lower end"
    return f"from {number(lower)}" if upper is None else f"{number(lower)} to {number(upper)}"


def number(value: float) -> str:
    """A whole number with all its digits, another one as short as it can be."""
    return str(int(value)) if value == int(value) else f"{value:g}"


if __name__ == "__main__":
    print(page())
