"""Reading configurations of the localizer from YAML files and presets.

A file contains the values that differ from the defaults::

    filter: particle
    particles: 75
"""

from pathlib import Path
from typing import Any

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.yaml_file import load_yaml, mapping
from tactile_localizer.resources import given_or_shipped

PRESETS = ("fast",)
"""Configurations that come with the package (``config/presets``; docs/tradeoff.md has the numbers)."""


def load_configuration(source: str | Path | None = None, **overrides: Any) -> Configuration:
    """Load a configuration from a preset or a file, with overrides.

    Parameters
    ----------
    source : name of a preset or path of a YAML file; ``None``: the defaults
    overrides : values by name that replace those of ``source``; ``None`` is ignored

    Raises
    ------
    ParameterError
        No such file or preset, an unknown name, or an invalid value.
    """
    given = {name: value for name, value in overrides.items() if value is not None}

    def convert(content: Any) -> Configuration:
        return Configuration.from_mapping({**mapping(content or {}, "configuration"), **given})

    if source is None:
        return convert({})
    path = given_or_shipped(f"{source}.yaml" if str(source) in PRESETS else source, "config/presets")
    what = f"a configuration file or one of {', '.join(PRESETS)}"
    return load_yaml(path, what, ParameterError, convert)
