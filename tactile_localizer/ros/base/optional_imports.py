"""Import of packages that only some parameter values require."""

from __future__ import annotations

import importlib
from typing import Any

from tactile_localizer.errors import ParameterError


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
