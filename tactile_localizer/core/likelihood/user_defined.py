"""Measurement models outside of the core: the paper's, or a user's.

They are named ``module:Class``, or as an installed package names them: by an entry point of :data:`GROUP`.
"""

import importlib
from contextlib import AbstractContextManager
from typing import Any

import numpy as np

from tactile_localizer.core.likelihood.base import MeasurementModel
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ParameterError, did_you_mean, listed
from tactile_localizer.plugins import installed, named_faults, only
from tactile_localizer.quantity import number
from tactile_localizer.scene import Scene

SEPARATOR = ":"
"""Separates module and class in the name of a model."""


GROUP = "tactile_localizer.models"
"""Group of the entry points; the name of one is that of a model."""


def class_of(name: str, *others: str) -> str:
    """The ``module:Class`` of a model that is named so, or by an installed package.

    Parameters
    ----------
    name : of the model
    others : names that are allowed beside these, for the message

    Raises
    ------
    ParameterError
        There is no such model, or several packages have one.
    """
    if SEPARATOR in name:
        return name
    models = installed(GROUP)
    if name not in models:
        known = [*others, *sorted(models)]
        expected = f"{listed(known)} or module:Class{did_you_mean(name, known)}"
        raise ParameterError(f"model {name!r}: expected {expected}")
    return only(models[name], ParameterError)[0].value


class NamedModel:
    """A measurement model, each of whose faults is an error that names it.

    Parameters
    ----------
    name : ``module:Class``, importable from Python's path, or the name of one in an installed package
    scan, scene : arguments of the class, in this order

    Attributes
    ----------
    name : as given

    Raises
    ------
    ParameterError
        No such module or class, it cannot be built, or its instance is not a measurement model.
    """

    def __init__(self, name: str, scan: Scan, scene: Scene) -> None:
        self.name = name
        module_name, _, class_name = class_of(name).partition(SEPARATOR)
        with self._named("a module on Python's path (PYTHONPATH)"):
            module = importlib.import_module(module_name)
        made: Any = getattr(module, class_name, None)
        if not isinstance(made, type):
            raise self._error(f"a class {class_name} in {module_name}", f"found {made!r:.80}")
        with self._named("a class that can be made with scan, scene"):
            self._model: MeasurementModel = made(scan, scene)
        if not isinstance(self._model, MeasurementModel):
            raise self._error("a measurement model", f"got {type(self._model).__name__}")

    @property
    def gives_length(self) -> bool:
        """Whether the model says what its strains are worth together."""
        return hasattr(self._model, "information_length")

    @property
    def information_length(self) -> float:
        """Travel per independent measurement, m, of a model that gives it.

        Raises
        ------
        ParameterError
            It is not positive.
        """
        length: Any = getattr(self._model, "information_length", None)
        return number(length, f"information_length of {self.name}", lower=1e-6)

    def log_likelihood(
        self, states: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> np.ndarray:
        """As :meth:`.MeasurementModel.log_likelihood`.

        Raises
        ------
        ParameterError
            The model fails, or gives something else than a log-density at each of the states.
        """
        with self._named("log-likelihoods"):
            made = np.asarray(self._model.log_likelihood(states.copy(), strain.copy(), present))
            found = made.astype(np.float64, casting="same_kind", copy=False)
        if found.shape != (len(states),):
            raise self._error(f"log-likelihoods of shape ({len(states)},)", f"got {found.shape}")
        if not np.all(found < np.inf):
            raise self._error("finite log-likelihoods", "got NaN or infinity")
        return found

    def _named(self, expected: str) -> AbstractContextManager[None]:
        """Context in which a failure of the model becomes an error that says where it is."""
        return named_faults(f"model {self.name!r}", expected, ParameterError)

    def _error(self, expected: str, found: str) -> ParameterError:
        return ParameterError(f"model {self.name!r}: expected {expected}, {found}")
