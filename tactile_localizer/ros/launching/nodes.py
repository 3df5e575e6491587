"""Launch descriptions of the nodes, with described arguments, in any namespace.

If a node ends, the launch ends with exit status 1. Only the launch files import this module; it needs
``launch`` and ``launch_ros`` from a ROS 2 distribution.
"""

from __future__ import annotations

import posixpath
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from launch.actions import OpaqueFunction
from launch.events.process import ProcessExited
from launch.logging import get_logger
from launch_ros.actions import LifecycleNode

from launch import LaunchContext, LaunchDescription
from tactile_localizer.errors import TactileLocalizerError
from tactile_localizer.resources import resource_path
from tactile_localizer.ros.base.executable import REJECTED
from tactile_localizer.ros.launching.arguments import (
    Argument,
    file,
    misspelt,
    positive,
    scene,
    strings,
    switch,
)
from tactile_localizer.sim.material import FEATURES

_PACKAGE = "tactile_localizer"
_RESPAWN_DELAY_S = 2.0

NAMESPACE = Argument("namespace", "Namespace of the nodes, for example left; one per hand")
_RESPAWN = switch("respawn", "Restart a crashed node, but not one that rejects its configuration", "false")
_LOG_LEVEL = Argument(
    "log_level", "Log level of the nodes", "info", choices=("debug", "info", "warn", "error", "fatal")
)
_SWITCHES = (
    switch("use_sim_time", "Take time from /clock", "false"),
    switch("autostart", "Configure and activate the nodes; false leaves both to a lifecycle manager", "true"),
)
COMMON = (NAMESPACE, *_SWITCHES, _RESPAWN, _LOG_LEVEL)
"""Arguments of every launch file."""

POSE_TOPIC = Argument("pose_topic", "Topic of the palm poses (geometry_msgs/PoseStamped)", "palm_pose")
BUS = (
    Argument("interface", "python-can interface of the CAN bus, for example socketcan"),
    Argument("channel", "Channel of the interface, for example can0"),
    Argument("bus_options", "Options of the interface, as a list: \"['bitrate=1000000']\"", kind=strings),
)
_SCENE_FILE = Argument("scene_file", "Scene (YAML): path or shipped file name", kind=scene)


@dataclass(frozen=True)
class Launched:
    """A node of a launch file.

    Parameters
    ----------
    name : name of the node; the executable is ``{name}_node``, the parameter file ``config/{name}.yaml``
    arguments : launch arguments that become parameters of the node unless they are empty
    remapped : launch argument with the name of each remapped topic
    fixed : parameters set by the launch file
    queues : depth of the subscription by topic, or by launch argument that names the topic
    when : name and value of the launch argument that selects the node; ``None``: always started
    """

    name: str
    arguments: Sequence[Argument] = ()
    remapped: Mapping[str, Argument] = field(default_factory=dict)
    fixed: Mapping[str, Any] = field(default_factory=dict)
    queues: Mapping[Argument | str, int] = field(default_factory=dict)
    when: tuple[str, str] | None = None

    @property
    def parameter_file(self) -> Argument:
        """The argument that names the parameter file of the node."""
        shipped = str(resource_path(f"config/{self.name}.yaml"))
        return Argument(f"{self.name}_params", f"Parameter file of the {self.name}", shipped, file)

    def is_wanted(self, context: LaunchContext) -> bool:
        """Whether the launch arguments select the node."""
        return self.when is None or context.launch_configurations[self.when[0]] == self.when[1]

    def action(self, context: LaunchContext) -> LifecycleNode:
        """The action that starts the node.

        Raises
        ------
        ParameterError
            An argument is invalid.
        """
        given = [*(a for a in self.arguments if a.text(context)), *_SWITCHES]
        parameters = {a.name: a.value(context) for a in given} | dict(self.fixed)
        for topic, depth in self.queues.items():
            parameters[f"qos_overrides.{resolved(topic, context)}.subscription.depth"] = depth
        respawn = _RESPAWN.value(context)
        return LifecycleNode(
            package=_PACKAGE,
            executable=f"{self.name}_node",
            name=self.name,
            namespace=NAMESPACE.text(context),
            parameters=[self.parameter_file.value(context), parameters],
            remappings=[(topic, argument.text(context)) for topic, argument in self.remapped.items()],
            ros_arguments=["--log-level", _LOG_LEVEL.text(context)],
            respawn=respawn,
            respawn_delay=_RESPAWN_DELAY_S,
            on_exit=_ending(self.name, respawn),
            output="screen",
        )


_FRAMES = (
    Argument(
        "pose_source",
        "Source of palm poses: pose_topic (topic), or lookup in tf",
        choices=("", "topic", "tf"),
    ),
    Argument("palm_frame", "Frame of the palm in tf"),
    Argument("reference_frame", "Frame of the palm poses, for example base_link"),
    Argument("material_frame", "Frame of the material; one per hand"),
)


def resolved(topic: Argument | str, context: LaunchContext) -> str:
    """The full name of a topic, or of the topic that an argument names, in the namespace of the launch."""
    name = topic.text(context) if isinstance(topic, Argument) else topic
    return posixpath.join(f"/{NAMESPACE.text(context).strip('/')}", name)


DRIVER = Launched(
    "driver",
    (
        *BUS,
        Argument("dbc", "CAN database (DBC): path or shipped file name"),
        Argument("phalanges", "Names of the load cells, as a list: [index, middle]", kind=strings),
    ),
)
MAPPING = Launched(
    "mapping",
    (Argument("scan_file", "Scan file to record to; an existing file is continued"), _SCENE_FILE, *_FRAMES),
    {"palm_pose": POSE_TOPIC},
)
FILTER = Launched(
    "filter",
    (
        Argument("scan_file", "Scan file, used as the map"),
        Argument(
            "candidate_scan_files",
            "Scan files of several features, as a list, instead of scan_file, to identify the feature",
            kind=strings,
        ),
        _SCENE_FILE,
        Argument("scan_directory", "Directory of the scan files that ~/load_scan may read"),
        *_FRAMES,
        switch("publish_tf", "Publish the transform to material_frame while converged"),
    ),
    {"palm_pose": POSE_TOPIC},
)
SIMULATOR = Launched(
    "simulator",
    (
        *BUS,
        Argument("feature", "Feature in the simulated material", choices=("", *FEATURES)),
        Argument("speed", "Simulated seconds per second of real time", kind=positive),
        Argument(
            "mode",
            "scan: training sweeps and the mapping; localize: sweeps from unknown positions and the filter; "
            "none: training sweeps only",
            "none",
            lambda mode: "localize" if mode == "localize" else "scan",
            ("scan", "localize", "none"),
        ),
    ),
)


FurtherActions = Callable[[LaunchContext, Sequence[LifecycleNode]], list[Any]]
"""Function that returns further actions, given the actions of the nodes."""


def nodes(
    *launched: Launched, arguments: Sequence[Argument] = (), further: FurtherActions | None = None
) -> LaunchDescription:
    """A launch description that declares the arguments of nodes and starts them.

    Parameters
    ----------
    launched : nodes to start
    arguments : further arguments of the launch file
    further : returns further actions
    """
    declared = {argument.name: argument for argument in (*COMMON, *arguments)}
    for node in launched:
        for argument in (node.parameter_file, *node.remapped.values(), *node.arguments):
            declared.setdefault(argument.name, argument)
    description = LaunchDescription([argument.declaration() for argument in declared.values()])
    description.add_action(OpaqueFunction(function=_warn_of_misspelt, args=[description]))
    description.add_action(OpaqueFunction(function=_start, args=[launched, further]))
    return description


def _warn_of_misspelt(context: LaunchContext, description: LaunchDescription) -> None:
    known = [argument.name for argument in description.get_launch_arguments()]
    for name, meant in misspelt(context.launch_configurations, known).items():
        get_logger("launch").warning(f"launch argument {name}: unknown, did you mean {meant}?")


def _start(context: LaunchContext, launched: Sequence[Launched], further: FurtherActions | None) -> list[Any]:
    """Start all nodes, or none if an argument is invalid."""
    started = [node.action(context) for node in launched if node.is_wanted(context)]
    return [*started, *(further(context, started) if further else ())]


def _ending(name: str, respawn: bool) -> Callable[[ProcessExited, LaunchContext], None]:
    """Handler that ends the launch with the node: the exit status is 1 only if a handler raises an error."""

    def end(event: ProcessExited, context: LaunchContext) -> None:
        if context.is_shutdown or (respawn and event.returncode != REJECTED):
            return
        raise TactileLocalizerError(
            f"{name}: expected a running node, it ended with status {event.returncode}"
        )

    return end
