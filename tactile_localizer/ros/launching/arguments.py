"""Arguments of the launch files: description, validation and conversion to parameters.

Only the launch files import this module; it needs ``launch`` from a ROS 2 distribution.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import yaml
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration

from launch import LaunchContext
from tactile_localizer.errors import ParameterError, TactileLocalizerError
from tactile_localizer.io.yaml_file import parse_yaml
from tactile_localizer.quantity import is_number, number
from tactile_localizer.resources import given_or_shipped

_BOOLEANS = {"true": True, "True": True, "false": False, "False": False}


@dataclass(frozen=True)
class Argument:
    """A launch argument.

    Parameters
    ----------
    name : name of the argument and of the parameter that it sets
    description : text for ``--show-args``
    default : default as text; empty for that of the parameter file, ``None`` if the argument is required
    kind : converts the text to the value, or raises an error
    choices : allowed texts; empty for any
    """

    name: str
    description: str
    default: str | None = ""
    kind: Callable[[str], Any] = str
    choices: Sequence[str] = ()

    def declaration(self) -> DeclareLaunchArgument:
        """The declaration, shown by ``--show-args``."""
        choices = list(self.choices) or None
        return DeclareLaunchArgument(
            self.name, default_value=self.default, description=self.description, choices=choices
        )

    def text(self, context: LaunchContext) -> str:
        """The text of the argument."""
        return str(LaunchConfiguration(self.name).perform(context))

    def value(self, context: LaunchContext) -> Any:
        """The value of the argument.

        Raises
        ------
        ParameterError
            The text is invalid; the message names the argument.
        """
        text = self.text(context)
        try:
            return self.kind(text)
        except ParameterError as error:
            raise ParameterError(f"launch argument {self.name}: expected {error}, got {text!r}") from None
        except TactileLocalizerError as error:
            raise ParameterError(f"launch argument {self.name}: {error}") from None


def switch(name: str, description: str, default: str = "") -> Argument:
    """A boolean argument."""
    choices = tuple(_BOOLEANS) if default else ("", *_BOOLEANS)
    return Argument(name, description, default, _BOOLEANS.__getitem__, choices)


def strings(text: str) -> list[str]:
    """Parse a list of strings in YAML."""
    try:
        found = parse_yaml(text)
    except yaml.YAMLError:
        found = None
    if not isinstance(found, list) or not all(isinstance(entry, str) for entry in found):
        raise ParameterError("a list of names such as \"['a', 'b']\"")
    return found


def positive(text: str) -> float:
    """Parse a finite number above zero."""
    found = number(text, "number", finite=False) if is_number(text) else math.nan
    if not 0.0 < found < math.inf:
        raise ParameterError("a number above 0")
    return found


def file(text: str) -> str:
    """The path of an existing file."""
    if not Path(text).is_file():
        raise ParameterError("an existing file")
    return text


def scene(text: str) -> str:
    """The path of a scene file, or of a shipped one."""
    return str(given_or_shipped(text, "config/scenes"))


def misspelt(given: Iterable[str], known: Sequence[str]) -> dict[str, str]:
    """Near match of each unknown argument; a launch file that includes these may declare others."""
    near = {name: get_close_matches(name, known, n=1, cutoff=0.8) for name in given if name not in known}
    return {name: found[0] for name, found in near.items() if found}
