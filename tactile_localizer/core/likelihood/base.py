"""Interface of the measurement models, and checks of their arguments."""

import math
import reprlib
from typing import Any, Protocol, runtime_checkable

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import MeasurementError
from tactile_localizer.scene import Scene

_LARGEST = 1e100


@runtime_checkable
class MeasurementModel(Protocol):
    """P(z | x), built from a scan and a scene.

    A model may have an attribute ``information_length``, m of travel per independent measurement; without
    it, held-out sweeps of the scan give it.
    """

    def log_likelihood(
        self, states: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> np.ndarray:
        """Log-density of a strain vector at states, (P,), finite.

        Parameters
        ----------
        states : (P, d) m (yaw: rad)
        strain : (C,) V
        present : (F,) bool, phalanges that count; ``None``: all

        Raises
        ------
        MeasurementError
            The strain of a present phalanx is not finite, or the shape is wrong.
        """


def checked(
    strain: np.ndarray, layout: ChannelLayout, present: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """The strain (C,) as float64, zero for absent phalanges, and the flags ``present`` (F,).

    Raises
    ------
    MeasurementError
        A wrong shape, no phalanx present, or a value in a present phalanx that is not finite or over 1e100.
    """
    strain = real_numbers(strain, "strain")
    phalanges = layout.phalanges
    if strain.shape != (layout.size,):
        raise MeasurementError(f"strain: expected shape ({layout.size},), got {strain.shape}")
    if present is None:
        _require_finite(strain)
        return strain, layout.every
    present = real_numbers(present, "present").astype(bool)
    count = np.count_nonzero(present)
    if present.shape != (phalanges,) or not count:
        raise MeasurementError(f"present: expected {phalanges} flags, at least one set, got {present}")
    if count < phalanges:
        strain = np.where(layout.expand(present), strain, 0.0)
    _require_finite(strain)
    return strain, present


def real_numbers(values: Any, what: str) -> np.ndarray:
    """``values`` as an array of float64.

    Raises
    ------
    MeasurementError
        They are text, complex, or nested unevenly; the message calls them ``what``.
    """
    try:
        found = np.asarray(values)
    except ValueError:
        found = np.empty(0, dtype=object)
    if found.dtype.kind not in "fiub":
        raise MeasurementError(f"{what}: expected real numbers, got {reprlib.repr(values)}")
    return found.astype(np.float64, copy=False)


def has_finite_squares(numbers: np.ndarray) -> bool:
    """Whether all numbers (N,) are finite, and small enough that their squares are."""
    return math.hypot(*numbers.tolist()) < _LARGEST


def _require_finite(strain: np.ndarray) -> None:
    if not has_finite_squares(strain):
        raise MeasurementError(f"strain: expected finite volts, found NaN, infinity or over {_LARGEST:g}")


def training_pairs(scan: Scan, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Positions (N, d) and strains (N, C) of a scan on the axes and phalanges of a scene.

    Raises
    ------
    SceneError
        The scene names an axis or a phalanx that the scan does not have.
    """
    positions = scan.positions_on(scene)
    if scene.wraps.any():
        positions = np.where(scene.wraps, wrap_angle(positions), positions)
    return positions, scan.strain_on(scene)
