"""The sum-of-Gaussians measurement model (paper, III-C, Eq. 4)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.likelihood.base import MeasurementModel, checked, positive
from tactile_localizer.core.likelihood.kernels.background import Background
from tactile_localizer.core.likelihood.kernels.grid import box
from tactile_localizer.core.likelihood.kernels.interpolation import interpolated
from tactile_localizer.core.likelihood.kernels.sums import KernelSum
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ParameterError
from tactile_localizer.scene import Scene

FLOOR = 0.01
"""Share of the broad background in the density, at a typical density of the scan."""
_SAFE = 600.0
"""Difference of logarithms whose exponential neither overflows nor underflows."""


class PhalanxKernels:
    """A kernel density of strain given position over one set of phalanges, with the background as its floor.

    .. math:: p(z | x) = (S(x, z) + a\\, b(z)) / (D(x) + a)

    where S is the sum over pairs of position kernel times strain kernel, D the sum of the position kernel
    alone and b the :class:`Background`. ``a`` is :data:`FLOOR` times the D of an evenly spread scan: where
    nothing was scanned, the background is all that is known. ``conditional=False`` is the paper's form, in
    which P(x) is taken as constant: D is then that of an evenly spread scan everywhere.

    Parameters
    ----------
    positions, strain : (N, d) and (N, C) the pairs
    position_std, strain_std : (d,) and (C,) kernel widths
    layout : the strains' channels by phalanx; ``None``: the default channels each
    """

    def __init__(
        self,
        positions: np.ndarray,
        strain: np.ndarray,
        position_std: np.ndarray,
        strain_std: np.ndarray,
        wraps: np.ndarray,
        conditional: bool = True,
        evaluation: str = "field",
        dtype: Any = np.float64,
        layout: ChannelLayout | None = None,
    ) -> None:
        self.kernels = KernelSum(
            positions, strain, position_std, strain_std, wraps, evaluation, dtype, layout
        )
        self.background = Background(strain, strain_std, layout)
        self._conditional = conditional
        kernel = position_std * math.sqrt(2.0 * math.pi)
        low, high = box(positions)
        self._typical = len(positions) * float(np.prod(kernel / np.maximum(high - low, kernel)))

    def at_states(self, states: np.ndarray, strain: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Log-density at states (P, d): (P,)."""
        log_floor = self._log_floor(strain, present)
        return self._mix(*self.kernels.at_states(states, strain, present, log_floor), log_floor)

    def on_axes(self, axes: list[np.ndarray], strain: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Log-density at every combination of coordinates: (C1, ..., Cd)."""
        log_floor = self._log_floor(strain, present)
        return self._mix(*self.kernels.on_axes(axes, strain, present, log_floor), log_floor)

    def _log_floor(self, strain: np.ndarray, present: np.ndarray) -> float:
        return math.log(FLOOR * self._typical) + self.background.log_density(strain, present)

    def _mix(self, sums: np.ndarray, density: np.ndarray, log_scale: float, log_floor: float) -> np.ndarray:
        floor = FLOOR * self._typical
        scanned = (density if self._conditional else self._typical) + floor
        if abs(log_floor - log_scale) < _SAFE:
            return np.log((sums + math.exp(log_floor - log_scale)) / scanned) + log_scale
        with np.errstate(divide="ignore"):
            return np.logaddexp(np.log(sums) + log_scale, log_floor) - np.log(scanned)


class SumOfGaussians(MeasurementModel):
    """Every training pair is a Gaussian bump in state and strain (paper, Eq. 4).

    Parameters
    ----------
    scan, scene : the training pairs and what is modelled
    position_std : square root of the diagonal of Sigma_x, one number or one an axis, m (yaw: rad)
    strain_std : square root of the diagonal of Sigma_z, one number or one a channel, V
    conditional : divide by the scan's own density in x, right where the scan is uneven; ``False``: the
        paper's joint form with constant P(x)
    evaluation : ``field``, ``truncated`` or ``exact`` (:mod:`.kernel_sum`)
    precision : ``float64`` or ``float32``

    Raises
    ------
    ParameterError
        A width that is not positive, or an unknown evaluation or precision.
    SceneError
        The scene names a phalanx that the scan does not have.
    """

    def __init__(
        self,
        scan: Scan,
        scene: Scene,
        position_std: Any,
        strain_std: Any,
        conditional: bool = True,
        evaluation: str = "field",
        precision: str = "float64",
    ) -> None:
        positions, strain = training_pairs(scan, scene)
        self._layout = scene.layout
        self._kernels = PhalanxKernels(
            positions,
            strain,
            positive("position_std", position_std, scene.dimension),
            positive("strain_std", strain_std, self._layout.size),
            scene.wraps,
            conditional,
            evaluation,
            dtype_of(precision),
            self._layout,
        )

    def log_likelihood(
        self, states: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> np.ndarray:
        """See :meth:`MeasurementModel.log_likelihood`."""
        strain, present = checked(strain, self._layout, present)
        kernels = self._kernels.kernels
        if kernels.evaluation == "field":
            return interpolated(
                states,
                kernels.position_std,
                lambda points: self._kernels.at_states(points, strain, present),
                lambda axes: self._kernels.on_axes(axes, strain, present),
            )
        return self._kernels.at_states(states, strain, present)


def training_pairs(scan: Scan, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """The scan's positions (N, d) and strains (N, C) on the axes and phalanges that the scene names.

    Raises
    ------
    SceneError
        The scene names an axis or a phalanx that the scan does not have.
    """
    positions = _columns(scan.states, scene.columns(scan.axes))
    if scene.wraps.any():
        positions = np.where(scene.wraps, wrap_angle(positions), positions)
    return positions, _columns(scan.strain, scene.channels(scan.phalanges, scan.channels))


def _columns(array: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Some columns, or the array itself where they are all of them: no large scan is copied for nothing."""
    return array if np.array_equal(columns, np.arange(array.shape[1])) else array[:, columns]


def dtype_of(precision: str) -> Any:
    """float64 or float32 by name.

    Raises
    ------
    ParameterError
        Another name.
    """
    if precision not in ("float64", "float32"):
        raise ParameterError(f"precision {precision!r}: expected float64 or float32")
    return np.dtype(precision)
