"""Measurement models outside of the core, named ``module:Class``: the paper's, or a user's."""

from __future__ import annotations

import importlib
from typing import Any

from tactile_localizer.core.likelihood.base import MeasurementModel
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ParameterError
from tactile_localizer.scene import Scene

SEPARATOR = ":"
"""Separates module and class in the name of a model."""


def build_named_model(name: str, scan: Scan, scene: Scene) -> MeasurementModel:
    """Build a measurement model from its name.

    Parameters
    ----------
    name : ``module:Class``, importable from Python's path
    scan, scene : arguments of the class, in this order

    Raises
    ------
    ParameterError
        No such module or class, or its instance is not a measurement model.
    """
    module_name, _, class_name = name.partition(SEPARATOR)
    try:
        module = importlib.import_module(module_name)
    except (ImportError, TypeError, ValueError) as error:
        raise ParameterError(
            f"model {name!r}: expected a module on Python's path (PYTHONPATH), {error}"
        ) from None
    made: Any = getattr(module, class_name, None)
    if not isinstance(made, type):
        raise ParameterError(
            f"model {name!r}: expected a class {class_name} in {module_name}, found {made!r:.80}"
        )
    try:
        model = made(scan, scene)
    except TypeError as error:
        raise ParameterError(f"model {name!r}: expected arguments scan, scene, {error}") from None
    if not isinstance(model, MeasurementModel):
        raise ParameterError(f"model {name!r}: expected a measurement model, got {type(model).__name__}")
    return model
