"""What the launch files have in common: nodes with described arguments, in any namespace.

A node that ends while the launch goes on ends the launch with exit status 1. Only the launch files import
this; it needs ``launch`` and ``launch_ros``, which a ROS 2 distribution has.
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
from tactile_localizer.ros.base.executable import REFUSED
from tactile_localizer.ros.launching.arguments import (
    Argument,
    file,
    mistyped,
    positive,
    scene,
    strings,
    switch,
)
from tactile_localizer.sim.material import FEATURES

_PACKAGE = "tactile_localizer"
_RESPAWN_DELAY_S = 2.0

NAMESPACE = Argument("namespace", "Namespace of the nodes, such as left; two hands have two")
_RESPAWN = switch(
    "respawn", "Start a node again that has crashed; not one that refuses its parameters", "false"
)
_LOG_LEVEL = Argument(
    "log_level", "Of the nodes", "info", choices=("debug", "info", "warn", "error", "fatal")
)
_SWITCHES = (
    switch("use_sim_time", "Take time from /clock", "false"),
    switch("autostart", "Configure and activate the nodes; false leaves that to a lifecycle manager", "true"),
)
COMMON = (NAMESPACE, *_SWITCHES, _RESPAWN, _LOG_LEVEL)
"""Arguments of every launch file."""

POSE_TOPIC = Argument("pose_topic", "Topic of the palm poses (geometry_msgs/PoseStamped)", "palm_pose")
BUS = (
    Argument("interface", "python-can interface of the load cells' bus, such as socketcan"),
    Argument("channel", "Channel of the interface, such as can0"),
    Argument("bus_options", "Further options, as a list: \"['bitrate=1000000']\"", kind=strings),
)
_SCENE_FILE = Argument(
    "scene_file", "Scene (YAML): a path, or the name of one that comes with the package", kind=scene
)


@dataclass(frozen=True)
class Launched:
    """A node of a launch file.

    Parameters
    ----------
    name : of the node; the executable is ``{name}_node``, the parameter file ``config/{name}.yaml``
    arguments : those that become parameters of the node, unless they are empty
    remapped : by topic, the launch argument that says what it is called
    fixed : parameters that the launch file decides
    queues : by argument that names a topic, or by topic, how many messages may wait for the node
    when : name and value of a launch argument without which the node is not started
    """

    name: str
    arguments: Sequence[Argument] = ()
    remapped: Mapping[str, Argument] = field(default_factory=dict)
    fixed: Mapping[str, Any] = field(default_factory=dict)
    queues: Mapping[Argument | str, int] = field(default_factory=dict)
    when: tuple[str, str] | None = None

    @property
    def parameter_file(self) -> Argument:
        """The argument that names the node's parameter file."""
        shipped = str(resource_path(f"config/{self.name}.yaml"))
        return Argument(f"{self.name}_params", f"Parameter file of the {self.name}", shipped, file)

    def is_wanted(self, context: LaunchContext) -> bool:
        """Whether the launch arguments ask for the node."""
        return self.when is None or context.launch_configurations[self.when[0]] == self.when[1]

    def action(self, context: LaunchContext) -> LifecycleNode:
        """Starts the node, with the arguments as they were given.

        Raises
        ------
        ParameterError
            An argument's text cannot be used; names the argument.
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
        "Palm poses arrive on pose_topic (topic), or are looked up in tf",
        choices=("", "topic", "tf"),
    ),
    Argument("palm_frame", "Frame that is looked up in tf"),
    Argument("reference_frame", "Frame that palm poses are in, such as base_link"),
    Argument("material_frame", "Frame of the material; two hands have two"),
)


def resolved(topic: Argument | str, context: LaunchContext) -> str:
    """The full name of a topic in the launch's namespace, or of the one that an argument names."""
    name = topic.text(context) if isinstance(topic, Argument) else topic
    return posixpath.join(f"/{NAMESPACE.text(context).strip('/')}", name)


DRIVER = Launched(
    "driver",
    (
        *BUS,
        Argument("dbc", "CAN database: a path, or the name of one that comes with the package"),
        Argument("phalanges", "Names of the load cells, as a list: [index, middle]", kind=strings),
    ),
)
MAPPING = Launched(
    "mapping",
    (Argument("scan_file", "Scan file; recording goes on in one that exists"), _SCENE_FILE, *_FRAMES),
    {"palm_pose": POSE_TOPIC},
)
FILTER = Launched(
    "filter",
    (
        Argument("scan_file", "Scan file: the map"),
        Argument(
            "candidate_scan_files",
            "Scan files of several features, as a list, in place of scan_file: which is it?",
            kind=strings,
        ),
        _SCENE_FILE,
        Argument("scan_directory", "Directory that ~/load_scan may read scan files from"),
        *_FRAMES,
        switch("publish_tf", "Publish where the material is, while converged"),
    ),
    {"palm_pose": POSE_TOPIC},
)
SIMULATOR = Launched(
    "simulator",
    (
        *BUS,
        Argument("feature", "What lies in the simulated material", choices=("", *FEATURES)),
        Argument("speed", "Simulated seconds per second", kind=positive),
        Argument(
            "mode",
            "scan: sweeps to train on, with the mapping; localize: from unknown places, with the filter; "
            "none: to train on, with neither",
            "none",
            lambda mode: "localize" if mode == "localize" else "scan",
            ("scan", "localize", "none"),
        ),
    ),
)


Beside = Callable[[LaunchContext, Sequence[LifecycleNode]], list[Any]]
"""Makes what a launch file does beside its nodes, which it is given."""


def nodes(
    *launched: Launched, arguments: Sequence[Argument] = (), beside: Beside | None = None
) -> LaunchDescription:
    """A launch description that declares what the nodes need, once, and starts them.

    Parameters
    ----------
    launched : the nodes
    arguments : of the launch file itself
    beside : makes further actions
    """
    declared = {argument.name: argument for argument in (*COMMON, *arguments)}
    for node in launched:
        for argument in (node.parameter_file, *node.remapped.values(), *node.arguments):
            declared.setdefault(argument.name, argument)
    description = LaunchDescription([argument.declaration() for argument in declared.values()])
    description.add_action(OpaqueFunction(function=_warn_of_mistyped, args=[description]))
    description.add_action(OpaqueFunction(function=_start, args=[launched, beside]))
    return description


def _warn_of_mistyped(context: LaunchContext, description: LaunchDescription) -> None:
    known = [argument.name for argument in description.get_launch_arguments()]
    for name, meant in mistyped(context.launch_configurations, known).items():
        get_logger("launch").warning(f"launch argument {name}: not known, did you mean {meant}?")


def _start(context: LaunchContext, launched: Sequence[Launched], beside: Beside | None) -> list[Any]:
    """All nodes, or none where an argument cannot be used."""
    started = [node.action(context) for node in launched if node.is_wanted(context)]
    return [*started, *(beside(context, started) if beside else ())]


def _ending(name: str, respawn: bool) -> Callable[[ProcessExited, LaunchContext], None]:
    """Ends the launch with the node: launch's exit status is 1 where a handler raises, and 0 otherwise."""

    def end(event: ProcessExited, context: LaunchContext) -> None:
        if context.is_shutdown or (respawn and event.returncode != REFUSED):
            return
        raise TactileLocalizerError(
            f"{name}: expected the node to go on, it ended with status {event.returncode}"
        )

    return end
