"""Configuration of the localizer: model, filter, and their parameters."""

from __future__ import annotations

import dataclasses
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tactile_localizer.core.likelihood.user_defined import class_of
from tactile_localizer.errors import ParameterError, did_you_mean
from tactile_localizer.quantity import is_number, number, whole_number

SWEEP_MIXTURE = "sweep_mixture"
"""The default model, which learns its noise from the scan (:mod:`.sweep_mixture`)."""
FILTERS = ("grid", "particle")

RANGES: dict[str, tuple[float, float]] = {
    "particles": (1, 1_000_000),
    "cell": (0.01, 10.0),
    "resample_below": (0.01, 1.0),
    "random_particles": (0, 1_000_000),
    "update_distance": (1e-6, 1.0),
    "convergence_radius": (1e-6, 1.0),
    "convergence_yaw_radius": (1e-6, 10.0),
    "convergence_probability": (0.5, 1.0 - 1e-9),
    "convergence_travel": (0.0, 1.0),
}
"""Least and largest value of each number, in its unit."""


@dataclass(frozen=True)
class Configuration:
    """Parameters that do not depend on the material.

    Parameters
    ----------
    model : :data:`SWEEP_MIXTURE`, or another measurement model for the position (:mod:`.user_defined`): as
        ``module:Class``, such as the paper's in :mod:`tactile_localizer.paper`, or by the name that an
        installed package gives it
    filter : one of :data:`FILTERS`; ``grid`` is exact but for the size of its cells
    particles : number of particles; 75 in the paper
    cell : size of the grid's cells in line spacings of the scan; on one axis cells are 0.5 mm, on three so
        large that there are at most 25,000
    resample_below : fraction of the particles below which the effective sample size leads to resampling; 1:
        at every update
    random_particles : number of particles replaced by uniformly random ones at every update; 10 in the paper
    update_distance : m of travel between two measurement updates
    convergence_radius : m about the estimate within which the hand has to be
    convergence_yaw_radius : the same for yaw, rad
    convergence_probability : probability of being on the map and within the radius above which the position
        has converged
    convergence_travel : m of travel over which this must hold

    Raises
    ------
    ParameterError
        An unknown choice, or a number out of its range.
    """

    model: str = SWEEP_MIXTURE
    filter: str = "grid"
    particles: int = 1000
    cell: float = 0.45
    resample_below: float = 0.5
    random_particles: int = 0
    update_distance: float = 0.0005
    convergence_radius: float = 0.0075
    convergence_yaw_radius: float = 0.15
    convergence_probability: float = 0.97
    convergence_travel: float = 0.001

    def __post_init__(self) -> None:
        if self.model != SWEEP_MIXTURE:
            class_of(self.model, SWEEP_MIXTURE)  # raises
        if self.filter not in FILTERS:
            raise ParameterError(f"filter {self.filter!r}: expected one of {', '.join(FILTERS)}")
        for name, (lower, upper) in RANGES.items():
            number(getattr(self, name), name, lower=lower, upper=upper)
        if self.random_particles and self.filter == "grid":
            raise ParameterError(
                f"random_particles: expected 0 with filter grid, got {self.random_particles}"
            )

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
                hint = did_you_mean(str(name), fields)
                raise ParameterError(f"parameter {name!r}: expected one of {', '.join(fields)}{hint}")
            kind = type(fields[name].default)
            if kind is float and is_number(value):
                value = number(value, name)
            if kind is int and is_number(value):
                value = whole_number(value, name)
            if type(value) is not kind:
                raise ParameterError(f"{name}: expected {kind.__name__}, got {reprlib.repr(value)}")
            checked[name] = value
        return cls(**checked)
