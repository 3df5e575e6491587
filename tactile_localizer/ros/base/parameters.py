"""Parameters with description, unit and range; an invalid value is rejected with the reason."""

import importlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rclpy
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node

from tactile_localizer.errors import ParameterError, did_you_mean


@dataclass(frozen=True)
class Parameter:
    """One parameter of a node.

    Parameters
    ----------
    name : name, with dots between group and member
    default : a bool, int, float, str, or list, which determines the type. An empty list is a list of strings;
        it can also be written ``['']``, because the command line cannot give an empty list a type
    description : one sentence without its full stop
    unit : SI unit; empty if dimensionless
    lower, upper : inclusive range of an int or a float, from which rclpy also excludes NaN; both or none
    choices : allowed strings, or entries of a list of strings; empty for any
    live : whether it can be changed while the node is configured; other parameters are read on configuration
    at_start : whether it can only be given at the start, unless :data:`REMOTE` is, too: it names a file, a
        device or code, or is sent to hardware, and any participant of the ROS domain can set parameters
    """

    name: str
    default: Any
    description: str
    unit: str = ""
    lower: float | None = None
    upper: float | None = None
    choices: Sequence[str] = ()
    live: bool = False
    at_start: bool = False

    def descriptor(self) -> ParameterDescriptor:
        """The descriptor, shown by ``ros2 param describe``."""
        text = f"{self.description} [{self.unit}]" if self.unit else self.description
        constraints = [f"one of {', '.join(self.choices)}"] if self.choices else []
        constraints += ["given at the start"] if self.at_start else []
        descriptor = ParameterDescriptor(
            name=self.name, description=text, additional_constraints=", ".join(constraints)
        )
        if self.lower is not None and self.upper is not None:
            if isinstance(self.default, float):
                ends = {"from_value": float(self.lower), "to_value": float(self.upper)}
                descriptor.floating_point_range = [FloatingPointRange(**ends)]
            else:
                ends = {"from_value": int(self.lower), "to_value": int(self.upper)}
                descriptor.integer_range = [IntegerRange(**ends)]
        return descriptor


REMOTE = Parameter(
    "allow_remote_configuration",
    False,
    "Let every participant of the ROS domain set the parameters that are given at the start",
    at_start=True,
)


class Parameters:
    """The declared parameters of a node; ``parameters["rate_hz"]`` is the current value.

    Parameters
    ----------
    node : node that the parameters belong to
    declared : parameters to declare
    configured : returns whether the node is configured, when only live parameters can be changed

    Raises
    ------
    ParameterException
        A value from the command line or a file is out of range or of the wrong type; from rclpy.
    ParameterError
        It is an empty list.
    """

    def __init__(self, node: Node, declared: Iterable[Parameter], configured: Callable[[], bool]) -> None:
        self._node = node
        self._declared: dict[str, Parameter] = {}
        self._configured, self._has_started = configured, False
        node.add_on_set_parameters_callback(self._check)
        self.declare((REMOTE, *declared))
        self._has_started = True

    def declare(self, declared: Iterable[Parameter]) -> None:
        """Declare more parameters, such as a group per phalanx; skip those already declared.

        Each gets a value: a parameter without a value would empty the whole response of ``get_parameters``.
        """
        for parameter in declared:
            if parameter.name in self._declared:
                continue
            self._declared[parameter.name] = parameter
            default = rclpy.Parameter.Type.STRING_ARRAY if parameter.default == [] else parameter.default
            self._node.declare_parameter(parameter.name, default, parameter.descriptor())
            # [] on the command line has no type.
            if self._node.get_parameter_or(parameter.name).value is None:
                if parameter.default != []:
                    raise ParameterError(
                        f"parameter {parameter.name}: expected a value such as {parameter.default!r}, got []"
                    )
                self._node.set_parameters([rclpy.Parameter(parameter.name, default, [])])

    def __iter__(self) -> Iterator[Parameter]:
        """The declared parameters, in the order of declaration."""
        return iter(self._declared.values())

    def undeclared(self) -> list[str]:
        """Names given on the command line or in files that this node lacks, each with a near match.

        Members of groups (names with a dot) are not listed: the node declares them when it is configured.
        """
        # A private interface of rclpy; where a version lacks it, nothing is listed. The public
        # automatically_declare_parameters_from_overrides fails on an empty list.
        return [
            f"{name}{did_you_mean(name, self._declared)}"
            for name in getattr(self._node, "_parameter_overrides", ())
            if "." not in name and not self._node.has_parameter(name)
        ]

    def __getitem__(self, name: str) -> Any:
        value = self._node.get_parameter(name).value
        if self._declared[name].default == []:
            return [entry for entry in value if entry]
        return list(value) if isinstance(self._declared[name].default, list) else value

    def _is_change(self, new: rclpy.Parameter) -> bool:
        """Whether a parameter has another value; a loaded dump of all parameters repeats most of them."""
        old = self._node.get_parameter_or(new.name)
        return old.value is not None and (old.type_ != new.type_ or not np.array_equal(old.value, new.value))

    def _check(self, changes: list[rclpy.Parameter]) -> SetParametersResult:
        for change in changes:
            parameter = self._declared.get(change.name)
            if parameter is None:
                continue
            is_list = isinstance(parameter.default, list)
            entries = filter(None, change.value or ()) if is_list else [change.value]
            for entry in entries:
                if parameter.choices and entry not in parameter.choices:
                    reason = f"{change.name}: expected one of {', '.join(parameter.choices)}, got {entry!r}"
                    return SetParametersResult(successful=False, reason=reason)
            if not self._is_change(change):
                continue
            is_remote = self._has_started and (parameter is REMOTE or not self[REMOTE.name])
            if is_remote and parameter.at_start:
                reason = f"{change.name}: expected it at the start of the node, or {REMOTE.name} there"
                return SetParametersResult(successful=False, reason=reason)
            if self._configured() and not parameter.live:
                reason = f"{change.name}: expected an unconfigured node, cannot be changed while configured"
                return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)


def import_optional(module: str, parameter: str) -> Any:
    """Import a module that ``parameter`` requires.

    Raises
    ------
    ParameterError
        The package of the module is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise ParameterError(f"{parameter}: expected {package} to be installed, found none") from None
