"""Measurement models from outside the package, named as ``module:Class``."""

from __future__ import annotations

import importlib
from typing import Any

from tactile_localizer.core.likelihood.base import MeasurementModel
from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ParameterError
from tactile_localizer.scene import Scene

SEPARATOR = ":"
"""What tells a model of one's own from one of the package's."""


def build_own_model(name: str, scan: Scan, scene: Scene, parameters: ModelParameters) -> MeasurementModel:
    """The model that a class outside the package makes of a scan.

    Parameters
    ----------
    name : ``module:Class``; the module is imported from wherever Python finds it
    scan, scene, parameters : what the class is called with, in this order

    Raises
    ------
    ParameterError
        No such module, no such class in it, or what it makes is not a measurement model.
    """
    module_name, _, class_name = name.partition(SEPARATOR)
    try:
        module = importlib.import_module(module_name)
    except ImportError as error:
        raise ParameterError(
            f"model {name!r}: expected a module where Python looks for them (PYTHONPATH), {error}"
        ) from None
    made: Any = getattr(module, class_name, None)
    if not callable(made):
        raise ParameterError(f"model {name!r}: expected {class_name} in {module.__file__}, found none")
    model = made(scan, scene, parameters)
    if not isinstance(model, MeasurementModel):
        raise ParameterError(f"model {name!r}: expected a measurement model, got {type(model).__name__}")
    return model
