"""What the launch files have in common: nodes with described arguments, in any namespace.

Only the launch files import this; it needs ``launch`` and ``launch_ros``, which a ROS 2 distribution has.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Any

import yaml
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.logging import get_logger
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchContext, LaunchDescription
from tactile_localizer.resources import given_or_shipped, resource_path

_PACKAGE = "tactile_localizer"


@dataclass(frozen=True)
class Argument:
    """A launch argument that becomes a parameter of the same name, unless it is empty.

    Parameters
    ----------
    name : of both
    description : for ``--show-args``
    default : empty: as the parameter file has it
    kind : makes the parameter's value from the text
    """

    name: str
    description: str
    default: str = ""
    kind: Callable[[str], Any] = str


@dataclass(frozen=True)
class Launched:
    """A node of a launch file.

    Parameters
    ----------
    name : the executable less ``_node``, and the parameter file in ``config/`` less ``.yaml``
    arguments : those that become parameters of the node
    remapped : by topic, the launch argument that says what it is called
    fixed : parameters that the launch file decides
    when : name and value of a launch argument without which the node is not started
    """

    name: str
    arguments: Sequence[Argument] = ()
    remapped: Mapping[str, str] = field(default_factory=dict)
    fixed: Mapping[str, Any] = field(default_factory=dict)
    when: tuple[str, str] | None = None

    def start(self, context: LaunchContext) -> Node:
        """The node, with the arguments as they were given."""

        def given(argument: str) -> str:
            return str(LaunchConfiguration(argument).perform(context))

        parameters: dict[str, Any] = {
            argument.name: argument.kind(given(argument.name))
            for argument in self.arguments
            if given(argument.name)
        }
        parameters |= self.fixed
        for name in ("use_sim_time", "autostart"):
            parameters.setdefault(name, yaml.safe_load(given(name)))
        return Node(
            package=_PACKAGE,
            executable=f"{self.name}_node",
            namespace=given("namespace"),
            parameters=[given(f"{self.name}_params"), parameters],
            remappings=[(topic, given(argument)) for topic, argument in self.remapped.items()],
            ros_arguments=["--log-level", given("log_level")],
            respawn=yaml.safe_load(given("respawn")),
            respawn_delay=2.0,
            output="screen",
        )


COMMON = (
    Argument("namespace", "Namespace of the nodes, such as left; two hands have two"),
    Argument("use_sim_time", "Take time from /clock", "false"),
    Argument(
        "autostart", "Configure and activate the nodes; false leaves that to a lifecycle manager", "true"
    ),
    Argument("respawn", "Start a node again that has ended", "false"),
    Argument("log_level", "Of the nodes: debug, info, warn, error", "info"),
)
POSE_TOPIC = Argument("pose_topic", "Topic of the palm poses (geometry_msgs/PoseStamped)", "palm_pose")
BUS = (
    Argument("interface", "python-can interface of the load cells' bus, such as socketcan"),
    Argument("channel", "Channel of the interface, such as can0"),
    Argument("bus_options", "Further options, as a list: \"['bitrate=1000000']\"", kind=yaml.safe_load),
)
SCENE_FILE = Argument(
    "scene_file",
    "Scene (YAML): a path, or the name of one that comes with the package",
    kind=lambda name: str(given_or_shipped(name, "config/scenes")),
)

DRIVER = Launched(
    "driver",
    (
        *BUS,
        Argument("dbc", "CAN database: a path, or the name of one that comes with the package"),
        Argument("phalanges", "Names of the load cells, as a list: [index, middle]", kind=yaml.safe_load),
    ),
)
MAPPING = Launched(
    "mapping",
    (Argument("scan_file", "Scan file; recording goes on in one that exists"), SCENE_FILE),
    {"palm_pose": "pose_topic"},
)
FILTER = Launched(
    "filter",
    (
        Argument("scan_file", "Scan file: the map"),
        Argument(
            "candidate_scan_files",
            "Scan files of several features, as a list, in place of scan_file: which is it?",
            kind=yaml.safe_load,
        ),
        SCENE_FILE,
        Argument("scan_directory", "Directory that ~/load_scan may read scan files from"),
    ),
    {"palm_pose": "pose_topic"},
)
SIMULATOR = Launched(
    "simulator",
    (
        *BUS,
        Argument("feature", "What lies in the simulated material: bump, snap, grommet, seam or none"),
        Argument("speed", "Simulated seconds in a second", kind=float),
        Argument(
            "mode",
            "scan: sweeps to train on, with the mapping; localize: from unknown places, with the filter; "
            "none: to train on, with neither",
            "none",
            lambda mode: "localize" if mode == "localize" else "scan",
        ),
    ),
)


def nodes(*launched: Launched) -> LaunchDescription:
    """A launch description that declares what the nodes need, once, and starts them."""
    declared: dict[str, Argument] = {argument.name: argument for argument in COMMON}
    for node in launched:
        shipped = str(resource_path(f"config/{node.name}.yaml"))
        name = f"{node.name}_params"
        declared[name] = Argument(name, f"Parameter file of the {node.name}", shipped)
        if node.remapped:
            declared[POSE_TOPIC.name] = POSE_TOPIC
        for argument in node.arguments:
            declared.setdefault(argument.name, argument)
    actions: list[Any] = [
        DeclareLaunchArgument(argument.name, default_value=argument.default, description=argument.description)
        for argument in declared.values()
    ]
    actions += [OpaqueFunction(function=_start, args=[node]) for node in launched]
    description = LaunchDescription(actions)
    description.add_action(OpaqueFunction(function=_warn_of_mistyped, args=[description]))
    return description


def mistyped(given: Iterable[str], known: Sequence[str]) -> dict[str, str]:
    """By unknown argument, the known one that it nearly is; a file that includes ours may have others."""
    near = {name: get_close_matches(name, known, n=1, cutoff=0.8) for name in given if name not in known}
    return {name: found[0] for name, found in near.items() if found}


def _warn_of_mistyped(context: LaunchContext, description: LaunchDescription) -> None:
    known = [argument.name for argument in description.get_launch_arguments()]
    for name, meant in mistyped(context.launch_configurations, known).items():
        get_logger("launch").warning(f"launch argument {name}: not known, did you mean {meant}?")


def _start(context: LaunchContext, node: Launched) -> list[Node]:
    if node.when is not None and LaunchConfiguration(node.when[0]).perform(context) != node.when[1]:
        return []
    return [node.start(context)]
