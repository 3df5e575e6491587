"""Packages that only some parameters need."""

from __future__ import annotations

import importlib
from typing import Any

from tactile_localizer.errors import ParameterError


def import_optional(module: str, parameter: str) -> Any:
    """A module that the value of a parameter needs.

    Raises
    ------
    ParameterError
        The module's package is not installed; names the parameter.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise ParameterError(
            f"{parameter}: expected {module.partition('.')[0]} to be installed, found none"
        ) from None
