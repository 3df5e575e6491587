"""What every measurement model offers: the log-likelihood of a strain at any states."""

from __future__ import annotations

import math
from typing import Protocol, runtime_checkable

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.errors import MeasurementError, ParameterError

_LARGEST = 1e100


@runtime_checkable
class MeasurementModel(Protocol):
    """P(z | x), built from a scan and a scene.

    A phalanx that is not ``present`` drops out of the product over phalanges; the others go on. A class that
    derives from this one needs only :meth:`log_likelihood`.
    """

    def log_likelihood(
        self, states: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> np.ndarray:
        """Log-density of ``strain`` (C,), V, at each of ``states`` (P, d), m (yaw: rad): (P,), finite.

        ``present`` (F,) bool; ``None``: all phalanges.

        Raises
        ------
        MeasurementError
            The strain of a present phalanx is not finite, or the shape is wrong.
        """


def checked(
    strain: np.ndarray, layout: ChannelLayout, present: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """The strain as float64 with absent phalanges at zero, and which are present.

    Raises
    ------
    MeasurementError
        A wrong shape, no phalanx present, or NaN, infinity or numbers over 1e100 in a present phalanx.
    """
    strain = np.asarray(strain, dtype=np.float64)
    phalanges = layout.phalanges
    if strain.shape != (layout.size,):
        raise MeasurementError(f"strain: expected shape ({layout.size},), got {strain.shape}")
    if present is None:
        _require_usable(strain)
        return strain, np.ones(phalanges, dtype=bool)
    present = np.asarray(present, dtype=bool)
    felt = np.count_nonzero(present)
    if present.shape != (phalanges,) or not felt:
        raise MeasurementError(f"present: expected {phalanges} flags, at least one set, got {present}")
    if felt < phalanges:
        strain = np.where(layout.expand(present), strain, 0.0)
    _require_usable(strain)
    return strain, present


def usable(numbers: np.ndarray) -> bool:
    """Whether all of some numbers (N,) are finite, and so far from overflow that their squares are."""
    return math.hypot(*numbers.tolist()) < _LARGEST


def _require_usable(strain: np.ndarray) -> None:
    if not usable(strain):
        raise MeasurementError(f"strain: expected finite volts, found NaN, infinity or over {_LARGEST:g}")


def positive(name: str, value: object, size: int) -> np.ndarray:
    """A parameter as ``size`` positive finite numbers; a single number stands for all of them.

    Raises
    ------
    ParameterError
        Not a number, not positive, or the wrong count.
    """
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise ParameterError(f"{name}: expected numbers, got {value!r}") from None
    if array.shape not in ((), (size,)) or not (np.isfinite(array).all() and (array > 0).all()):
        raise ParameterError(f"{name}: expected one or {size} positive numbers, got {value!r}")
    return np.broadcast_to(array, (size,)).copy()


def flatten_axes(axes: list[np.ndarray]) -> np.ndarray:
    """Every combination of the coordinates of d axes, in C order: (C1 * ... * Cd, d)."""
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
