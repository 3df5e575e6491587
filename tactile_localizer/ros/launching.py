"""Nodes in launch files: their parameters as launch arguments, in any namespace.

If a node ends, the launch ends with exit status 1. Only the launch files import this module; it needs
``launch`` and ``launch_ros`` from a ROS 2 distribution.
"""

from __future__ import annotations

import posixpath
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.events.process import ProcessExited
from launch_ros.actions import Node

from launch import Action, LaunchContext
from tactile_localizer.errors import ParameterError, TactileLocalizerError
from tactile_localizer.resources import resource_path
from tactile_localizer.ros.base.executable import REJECTED
from tactile_localizer.ros.base.parameters import Parameter

_RESPAWN_DELAY_S = 2.0
_TRUE, _FALSE = ("true", "True"), ("false", "False")
_LEVELS = ("debug", "info", "warn", "error", "fatal")


def argument(parameter: Parameter, default: str | None = None) -> DeclareLaunchArgument:
    """Declare a launch argument with the description and the choices of a parameter.

    ``default`` is the text in place of the parameter's default; empty: it keeps its value.
    """
    choices = (*_TRUE, *_FALSE) if isinstance(parameter.default, bool) else parameter.choices
    if default == "" and choices:
        choices = ("", *choices)
    return DeclareLaunchArgument(
        parameter.name,
        default_value=str(parameter.default) if default is None else default,
        description=parameter.descriptor().description,
        choices=choices or None,
    )


_TOPICS = {"strain": "strain_topic", "palm_pose": "pose_topic"}
"""Launch argument with the name of each topic that all nodes share."""
_COMMON = ("use_sim_time", "autostart")
_QUEUE_DEPTH = Parameter("queue_depth", 100, "Depth of the subscriptions to strain and poses, 100 if empty")

COMMON = [
    argument(Parameter("namespace", "", "Namespace of the nodes, for example left; one per hand")),
    argument(Parameter("strain_topic", "strain", "Topic of the strain (tactile_localizer/StrainVectors)")),
    argument(Parameter("pose_topic", "palm_pose", "Topic of the palm poses (geometry_msgs/PoseStamped)")),
    argument(_QUEUE_DEPTH, ""),
    argument(Parameter("use_sim_time", False, "Take time from /clock")),
    argument(
        Parameter(
            "autostart", True, "Configure and activate the nodes; false leaves both to a lifecycle manager"
        )
    ),
    argument(
        Parameter("respawn", False, "Restart a crashed node, but not one that rejects its configuration")
    ),
    argument(Parameter("log_level", "info", "Log level of the nodes", choices=_LEVELS)),
]
"""Arguments of every launch file."""


def node(
    name: str, declared: Sequence[Parameter], arguments: Sequence[str], condition: Any = None
) -> list[Action]:
    """Actions that declare the launch arguments of a node and start it.

    Parameters
    ----------
    name : name of the node; the executable is ``{name}_node``, the parameter file ``config/{name}.yaml``, if
        there is one
    declared : parameters of the node
    arguments : names of the parameters that are launch arguments; an empty one keeps the value of the file
    condition : condition of the start
    """
    chosen = [parameter for parameter in declared if parameter.name in arguments]
    shipped = resource_path("config") / f"{name}.yaml"
    file = DeclareLaunchArgument(
        f"{name}_params",
        default_value=str(shipped) if shipped.is_file() else "",
        description=f"Parameter file of the {name}",
    )
    start = OpaqueFunction(function=_start, args=[name, chosen], condition=condition)
    return [*(argument(parameter, "") for parameter in chosen), file, start]


def _start(context: LaunchContext, name: str, chosen: Sequence[Parameter]) -> list[Action]:
    given: Mapping[str, str] = context.launch_configurations
    file = given[f"{name}_params"]
    if file and not Path(file).is_file():
        raise ParameterError(f"launch argument {name}_params: expected an existing file, got {file!r}")
    parameters: dict[str, Any] = {switch: given[switch] in _TRUE for switch in _COMMON}
    parameters |= {one.name: _value(one, given[one.name]) for one in chosen if given[one.name]}
    if given["queue_depth"]:
        depth = _value(_QUEUE_DEPTH, given["queue_depth"])
        for topic_argument in _TOPICS.values():
            topic = posixpath.join(f"/{given['namespace'].strip('/')}", given[topic_argument])
            parameters[f"qos_overrides.{topic}.subscription.depth"] = depth
    respawn = given["respawn"] in _TRUE
    return [
        Node(
            package="tactile_localizer",
            executable=f"{name}_node",
            name=name,
            namespace=given["namespace"],
            parameters=[*filter(None, [file]), parameters],
            remappings=[(topic, given[name]) for topic, name in _TOPICS.items()],
            ros_arguments=["--log-level", given["log_level"]],
            respawn=respawn,
            respawn_delay=_RESPAWN_DELAY_S,
            on_exit=_ending(name, respawn),
            output="screen",
        )
    ]


def _value(parameter: Parameter, text: str) -> Any:
    """The value of a launch argument, of the type of the parameter.

    Raises
    ------
    ParameterError
        The text is no such value; the message names the argument.
    """
    default = parameter.default
    if isinstance(default, str):
        return text
    try:
        value = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError, ValueError):
        value = None
    if isinstance(default, list):
        if isinstance(value, list) and all(isinstance(one, str) for one in value) and (value or not default):
            return value or [""]
        raise ParameterError(
            f"launch argument {parameter.name}: expected a list of names such as \"['a', 'b']\", got {text!r}"
        )
    if isinstance(default, bool):
        return value
    try:
        return type(default)(text)
    except ValueError:
        kind = "a whole number" if isinstance(default, int) else "a number"
        raise ParameterError(f"launch argument {parameter.name}: expected {kind}, got {text!r}") from None


def _ending(name: str, respawn: bool) -> Callable[[ProcessExited, LaunchContext], Shutdown | None]:
    """Handler that ends the launch with the node: the exit status is 1 only if a handler raises an error."""

    def end(event: ProcessExited, context: LaunchContext) -> Shutdown | None:
        if context.is_shutdown or (respawn and event.returncode != REJECTED):
            return None
        if name == "replay" and event.returncode == 0:
            return Shutdown(reason="the bag has ended")
        raise TactileLocalizerError(
            f"{name}: expected a running node, it ended with status {event.returncode}"
        )

    return end
