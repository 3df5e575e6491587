"""Arguments and nodes that the launch files share.

A launch that fails must leave no process behind, but launch does not stop what it started before an error in
the same description (ros2/launch, issue 747). So a launch file declares all arguments first, and no node
starts before the arguments of all its nodes are known to be valid.
"""

import sys
from collections.abc import Callable, Iterable
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import launch.logging
import yaml
from launch.actions import DeclareLaunchArgument, OpaqueFunction, TimerAction
from launch_ros.actions import LifecycleNode
from launch_ros.parameter_descriptions import ParameterValue

from launch import Action, LaunchContext
from tactile_localizer.resources import resource_path

NODE = ("namespace", "params_file", "use_sim_time", "autostart", "log_level")
"""Arguments of every node."""

_FLAGS = ("use_sim_time", "autostart")
_FLAG = {"default_value": "", "choices": ["", "true", "false", "True", "False"]}
_ARGUMENTS: dict[str, dict[str, Any]] = {
    "mode": {"choices": ["scan", "localize"], "description": "Mapping or filter"},
    "bag": {"description": "Bag to play"},
    "rate": {"default_value": "1.0", "description": "Speed of the replay"},
    "scan_file": {"description": "Scan (folder) that is the map, or to record or continue"},
    "scene_file": {"description": "Scene (YAML) to record: axes and phalanges"},
    "pose_topic": {"default_value": "palm_pose", "description": "Topic of the palm poses"},
    "sensor": {
        "default_value": "driver",
        "choices": ["driver", "adapter"],
        "description": "Node that publishes strain",
    },
    "namespace": {"default_value": "", "description": "Of the nodes"},
    "params_file": {"description": "Parameter file"},
    "use_sim_time": {**_FLAG, "description": "Time of /clock; if empty, as the parameter file has it"},
    "autostart": {**_FLAG, "description": "Start working; if empty, as the parameter file has it"},
    "log_level": {"default_value": "", "description": "debug, info, warn, error or fatal; if empty, info"},
}
_PARAMETERS: dict[str, tuple[str, ...]] = {
    "driver": (),
    "adapter": (),
    "mapping": ("scan_file", "scene_file"),
    "filter": ("scan_file",),
    "simulator": ("mode",),
}
"""Nodes, without the begin of their names, and the arguments that are parameters of each."""


def arguments(*names: str, params_file: str = "robot.yaml", **defaults: str) -> list[DeclareLaunchArgument]:
    """Declarations of arguments, some with another default.

    ``params_file`` is one of the shipped parameter files.
    """
    defaults["params_file"] = str(resource_path(f"config/{params_file}"))
    changed = {name: {"default_value": default} for name, default in defaults.items()}
    return [DeclareLaunchArgument(name, **_ARGUMENTS[name], **changed.get(name, {})) for name in names]


Then = Callable[..., list[Action]]


def nodes(*kinds: Any, then: Then | None = None, **parameters: Any) -> OpaqueFunction:
    """Action that starts nodes with the parameter file, and the arguments that are given on top of it.

    An argument that is not given is not passed on, so that actions such as ``SetParameter`` around the launch
    file apply.

    Parameters
    ----------
    kinds : executables without their ``_node``, as text or as a substitution
    then : called with the context and the nodes once these have their names; returns further actions. What
        they need is to be read from the context there: an event is handled after the scope of the launch
        file has ended
    parameters : values that are the same in each launch
    """
    return OpaqueFunction(function=_nodes, args=[kinds, then, parameters])


def _nodes(
    context: LaunchContext, kinds: tuple[Any, ...], then: Then | None, fixed: dict[str, Any]
) -> list[Action]:
    given = context.launch_configurations
    file = Path(given["params_file"]).expanduser()
    if not file.is_file():
        return [failure(f"params_file: expected a file, found none: {file}")]
    _warn_of_misspelt("argument", _typed(context), _ARGUMENTS, 0.8)
    _warn_of_misspelt(f"{file}:", _sections(file), [f"tactile_{kind}" for kind in _PARAMETERS], 0.6)
    flags = {name: given[name].lower() == "true" for name in _FLAGS if given.get(name)}
    level = given.get("log_level")
    started = []
    for kind in kinds:
        name = kind if isinstance(kind, str) else context.perform_substitution(kind)
        own = {key: ParameterValue(given[key], value_type=str) for key in _PARAMETERS[name]}
        started.append(
            LifecycleNode(
                package="tactile_localizer",
                executable=f"{name}_node",
                name=f"tactile_{name}",
                namespace=given["namespace"],
                parameters=[str(file), {**flags, **own, **fixed}],
                remappings=[("palm_pose", given.get("pose_topic", "palm_pose"))],
                ros_arguments=["--log-level", level] if level else None,
            )
        )
    return [*started, *([OpaqueFunction(function=then, args=started)] if then else [])]


def _typed(context: LaunchContext) -> list[str]:
    """Names of the arguments on the command line that starts this very file.

    Launch keeps arguments of all files in one dictionary, so what the file of somebody else has for itself
    cannot be told from what it gives to this one.
    """
    file = Path(context.get_locals_as_dict().get("current_launch_file_path", ""))
    words = sys.argv[1:]
    is_started = {"tactile_localizer", file.name} <= {*words} or file in [
        Path(word).absolute() for word in words
    ]
    return [word.partition(":=")[0] for word in context.argv if is_started]


def _warn_of_misspelt(what: str, names: Iterable[str], known: Iterable[str], similarity: float) -> None:
    """Warn of names that resemble known ones: launch and rcl ignore the others without a word."""
    for name in names:
        if name not in known and (near := get_close_matches(name, known, 1, similarity)):
            text = f"{what} {name}: expected {near[0]}; it is ignored"
            launch.logging.get_logger("tactile_localizer").warning(text)


def _sections(file: Path) -> list[str]:
    """Names of the nodes in a parameter file, without their namespaces; none in what is no such file."""
    try:
        content = yaml.safe_load(file.read_text())
    except (OSError, ValueError, yaml.YAMLError):
        content = None
    return [str(key).rpartition("/")[2] for key in content] if isinstance(content, dict) else []


def failure(text: str, after_s: float = 0.0) -> TimerAction:
    """Action that ends the launch with an error and status 1, and stops what was started before.

    Nothing happens if the launch ends by itself within ``after_s``.
    """

    def fail(context: LaunchContext) -> None:
        raise RuntimeError(text)

    return TimerAction(period=after_s, actions=[OpaqueFunction(function=fail)])
