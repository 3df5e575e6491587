"""Configurations in YAML: the choices of model, filter and work that a file or a preset makes.

A file names what differs from the defaults::

    model: sum_of_gaussians
    filter: particle
    particles: 75
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.errors import ParameterError
from tactile_localizer.resources import given_or_shipped

PRESETS = ("fast", "balanced", "accurate")
"""Configurations that come with the package (``config/presets``; docs/tradeoff.md has the numbers)."""


def load_configuration(source: str | Path | None = None, **overrides: Any) -> Configuration:
    """A configuration from a preset or a file, with some values given over it.

    Parameters
    ----------
    source : name of a preset or path of a YAML file; ``None``: the defaults
    overrides : by name, values that go first; those that are ``None`` are not given

    Raises
    ------
    ParameterError
        No such file or preset, an unknown name, or a value that cannot be used.
    """
    values = {} if source is None else _read(source)
    values |= {name: value for name, value in overrides.items() if value is not None}
    return Configuration.from_mapping(values)


def _read(source: str | Path) -> dict[str, Any]:
    path = _path(source)
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not text"
        raise ParameterError(
            f"{path}: expected a configuration file or one of {', '.join(PRESETS)}, {reason}"
        ) from None
    except yaml.YAMLError as error:
        raise ParameterError(f"{path}: expected YAML, {' '.join(str(error).split())}") from None
    content = {} if content is None else content
    if not isinstance(content, Mapping):
        raise ParameterError(f"{path}: expected a mapping of names to values, got {content!r}")
    values = {str(name): _number(value) for name, value in content.items()}
    try:
        Configuration.from_mapping(values)
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None
    return values


def _path(source: str | Path) -> Path:
    name = str(source)
    return given_or_shipped(f"{name}.yaml" if name in PRESETS else source, "config/presets")


def _number(value: Any) -> Any:
    # YAML reads 1e-3 (no dot) as text; take it as the number that it was meant to be.
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            return value
    return value
