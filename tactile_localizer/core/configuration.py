"""Which model, which filter, how much work: the choices that trade speed for accuracy."""

from __future__ import annotations

import dataclasses
import difflib
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tactile_localizer.core.filters.resampling import RESAMPLERS
from tactile_localizer.core.likelihood.kernels.sums import EVALUATIONS
from tactile_localizer.core.likelihood.user_defined import SEPARATOR
from tactile_localizer.errors import ParameterError
from tactile_localizer.quantity import is_number, number, whole_number

SWEEP_MIXTURE = "sweep_mixture"
"""The model that learns its noise from the scan and needs no kernel widths (:mod:`.sweep_localizer`)."""

MODELS = ("sum_of_gaussians", "gaussian", "gaussian_independent", "featureless")
FILTERS = ("grid", "particle")
RECOVERIES = ("evidence", "constant", "none")
PRECISIONS = ("float64", "float32")

_CHOICES = {
    "filter": FILTERS,
    "evaluation": EVALUATIONS,
    "precision": PRECISIONS,
    "resampling": tuple(RESAMPLERS),
    "recovery": RECOVERIES,
}


RANGES: dict[str, tuple[float, float]] = {
    "particles": (1, 1_000_000),
    "cell": (0.01, 10.0),
    "resample_below": (0.01, 1.0),
    "random_particles": (0, 1_000_000),
    "update_distance": (1e-6, 1.0),
    "convergence_std": (1e-6, 1.0),
    "convergence_yaw_std": (1e-6, 10.0),
    "convergence_evidence": (1e-3, 1e6),
    "convergence_travel": (0.0, 1.0),
}
"""Least and largest value of each number, in its unit."""


@dataclass(frozen=True)
class Configuration:
    """Choices that do not depend on the material.

    Parameters
    ----------
    model : measurement model, one of :data:`MODELS`, :data:`SWEEP_MIXTURE`, or one's own as
        ``module:Class`` (:mod:`.own_model`)
    filter : ``particle``, or ``grid``, the exact recursion on cells
    particles : how many particles
    cell : largest cell of the grid filter, in position kernel widths
    evaluation : how kernel sums are evaluated (:mod:`.kernel_sum`)
    precision : of the strains in memory, ``float64`` or ``float32``
    conditional : sum-of-Gaussians in conditional form; ``False``: the paper's joint form
    resampling : scheme (:mod:`.resampling`)
    resample_below : resample when the effective sample size falls below this share; 1: every step
    adaptive : choose the number of particles by KLD sampling, up to ``particles``
    recovery : ``evidence``: spread a contradicted belief; ``constant``: the paper's ``random_particles`` at
        each update (particle filter only); ``none``
    random_particles : of the constant recovery; the paper has 10 of 75
    update_distance : m of travel between two weighed strains
    convergence_std : m; the belief is narrow when its variances are on average below this squared
    convergence_yaw_std : the same for yaw, rad
    convergence_evidence : nats needed before the position may be believed
    convergence_travel : m of travel over which both must hold

    Raises
    ------
    ParameterError
        An unknown choice, or a number out of its range.
    """

    model: str = "sum_of_gaussians"
    filter: str = "grid"
    particles: int = 300
    cell: float = 0.3
    evaluation: str = "field"
    precision: str = "float32"
    conditional: bool = True
    resampling: str = "systematic"
    resample_below: float = 0.5
    adaptive: bool = False
    recovery: str = "evidence"
    random_particles: int = 10
    update_distance: float = 0.0005
    convergence_std: float = 0.005
    convergence_yaw_std: float = 0.1
    convergence_evidence: float = 3.0
    convergence_travel: float = 0.0005

    def __post_init__(self) -> None:
        if self.model not in (*MODELS, SWEEP_MIXTURE) and SEPARATOR not in self.model:
            known = ", ".join((*MODELS, SWEEP_MIXTURE))
            raise ParameterError(f"model {self.model!r}: expected one of {known}, or module:Class")
        for name, choices in _CHOICES.items():
            if getattr(self, name) not in choices:
                raise ParameterError(f"{name} {getattr(self, name)!r}: expected one of {', '.join(choices)}")
        for name, (lower, upper) in RANGES.items():
            if not lower <= getattr(self, name) <= upper:
                raise ParameterError(f"{name}: expected {lower:g} to {upper:g}, got {getattr(self, name)}")
        if self.model == SWEEP_MIXTURE and self.filter != "grid":
            raise ParameterError(f"filter: expected grid with model {SWEEP_MIXTURE}, got {self.filter}")
        if self.recovery == "constant" and self.filter == "grid":
            raise ParameterError("recovery constant: expected filter particle, got grid")

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Configuration:
        """From names and values, as a file or a node's parameters give them.

        Raises
        ------
        ParameterError
            An unknown name, a value of the wrong kind, or one out of its range.
        """
        fields = {field.name: field for field in dataclasses.fields(cls)}
        checked: dict[str, Any] = {}
        for name, value in values.items():
            if name not in fields:
                close = difflib.get_close_matches(str(name), fields, n=1)
                hint = f"; did you mean {close[0]}?" if close else f", one of {', '.join(fields)}"
                raise ParameterError(f"parameter {name!r}: expected a known name{hint}")
            kind = type(fields[name].default)
            if kind is float and is_number(value):
                value = number(value, name)
            if kind is int and is_number(value):
                value = whole_number(value, name)
            if type(value) is not kind:
                raise ParameterError(f"{name}: expected {kind.__name__}, got {reprlib.repr(value)}")
            checked[name] = value
        return cls(**checked)
