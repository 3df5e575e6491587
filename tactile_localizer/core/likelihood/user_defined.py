"""Measurement models outside of the core, named ``module:Class``: the paper's, or a user's."""

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from tactile_localizer.core.likelihood.base import MeasurementModel
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ParameterError, TactileLocalizerError, located
from tactile_localizer.quantity import number
from tactile_localizer.scene import Scene

SEPARATOR = ":"
"""Separates module and class in the name of a model."""


class NamedModel:
    """A measurement model named ``module:Class``, each of whose faults is an error that names it.

    Parameters
    ----------
    name : ``module:Class``, importable from Python's path
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
        module_name, _, class_name = name.partition(SEPARATOR)
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

    @contextmanager
    def _named(self, expected: str) -> Iterator[None]:
        """Context in which a failure of the model becomes an error that says where it is."""
        try:
            yield
        except TactileLocalizerError:
            raise
        except (Exception, SystemExit) as error:  # of code that is not ours
            raise self._error(expected, located(error)) from None

    def _error(self, expected: str, found: str) -> ParameterError:
        return ParameterError(f"model {self.name!r}: expected {expected}, {found}")
