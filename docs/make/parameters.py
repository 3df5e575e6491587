"""Writes docs/parameters.md from the parameters that the nodes declare: `make docs`.

The page goes to the file that is named, as DDS may print to standard output.
"""

import sys
from pathlib import Path

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

Every parameter of the nodes, with default and range, as `ros2 param describe NODE NAME` prints it
for a running node. Those marked **essential** must match the robot; the defaults of the others
usually suffice. What concerns the material is in the [scene](concepts.md#scene).

Parameters marked *live* can be changed at any time, the others while the node is not configured.
Those marked *start* name files, devices or code, or are sent to hardware: they are given at the
start of the node, and changed later only if `allow_remote_configuration` was given too. Invalid
values are rejected with the reason, unknown names ignored with a warning. On the command line an
empty list of strings is `"['']"`."""

ESSENTIAL = {
    "phalanges", "dbc", "channel", "scan_file", "scene_file", "adapter_file",
    "material_frame", "reference_frame", "material_pose", "convergence_radius",
}  # fmt: skip
"""Parameters to set for an installation: wiring, files, frames, and the required precision."""

NODES = {
    DriverNode: "Publishes the strain of load cells on a CAN bus ([can.md](can.md)).",
    MappingNode: "Records strain and palm poses to a scan ([scan.md](scan.md)).",
    FilterNode: "Estimates the palm position from strain and palm poses ([models.md](models.md)).",
    AdapterNode: "Converts messages of other tactile sensors to strain ([sensors.md](sensors.md)).",
    SimulatorNode: "Simulates the hand ([simulation.md](simulation.md)).",
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
    by_node = dict(zip(NODES, declared, strict=True))
    every = common(declared)
    inputs = [one for one in common([by_node[MappingNode], by_node[FilterNode]]) if one not in every]
    parts = [
        HEAD,
        section("Every node", "In addition to `use_sim_time` and `qos_overrides` of ROS.", every),
        section(
            "Inputs of mapping_node and filter_node", "Strain, and palm poses on a topic or in tf.", inputs
        ),
    ]
    for heading, (kind, purpose), parameters in zip(titles, NODES.items(), declared, strict=True):
        shared = every + inputs if kind in (MappingNode, FilterNode) else every
        own = [parameter for parameter in parameters if parameter not in shared]
        parts.append(section(heading, purpose, own))
    return "\n\n".join(parts)


def common(declared: list[list[Parameter]]) -> list[Parameter]:
    """Parameters that several nodes have alike."""
    return [parameter for parameter in declared[0] if all(parameter in others for others in declared[1:])]


def title(node: ManagedNode) -> str:
    """Executable and name of a node."""
    kind = type(node).__name__.removesuffix("Node").lower()
    return f"{kind}_node (`/{node.get_name()}`)"


def section(heading: str, purpose: str, parameters: list[Parameter]) -> str:
    """One table."""
    lines = [f"## {heading}", "", purpose, "", "| parameter | default | |", "|---|---|---|"]
    for parameter in parameters:
        essential = " **Essential.**" if parameter.name in ESSENTIAL else ""
        live = " *Live.*" if parameter.live else " *Start.*" if parameter.at_start else ""
        unit = f" [{parameter.unit}]" if parameter.unit else ""
        text = f"{sentence(f'{parameter.description}{unit}')}{essential}{live}".replace("|", "\\|")
        lines.append(f"| `{parameter.name}` | {shown(parameter.default)}{allowed(parameter)} | {text} |")
    return "\n".join(lines)


def sentence(text: str) -> str:
    """A description with a full stop."""
    return text if text.endswith((".", "?")) else f"{text}."


def shown(default: object) -> str:
    """A default in YAML."""
    if default == "":
        return '`""`'
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    if isinstance(default, list):
        return f"`[{', '.join(map(str, default))}]`"
    return f"`{default:g}`" if isinstance(default, float) else f"`{default}`"


def allowed(parameter: Parameter) -> str:
    """Range, or the other choices, in parentheses."""
    if parameter.choices:
        others = [f"`{choice}`" for choice in parameter.choices if choice != parameter.default]
        return f" (or {', '.join(others)})"
    lower, upper = parameter.lower, parameter.upper
    if lower is None and upper is None:
        return ""
    assert lower is not None, f"{parameter.name}: a range without a lower end"
    return f" (from {number(lower)})" if upper is None else f" ({number(lower)} to {number(upper)})"


def number(value: float) -> str:
    """An integer with all digits, another number as short as possible."""
    return str(int(value)) if value == int(value) else f"{value:g}"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(page() + "\n", encoding="utf-8")
