"""Sum-of-Gaussians measurement model (paper, III-C, Eq. 4)."""

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
from tactile_localizer.scene import Scene

FLOOR = 0.01
"""Weight of the background, relative to the kernel density of an evenly spread scan."""
_LARGEST_EXPONENT = 600.0
"""Magnitude of an exponent up to which its exponential neither overflows nor underflows."""


class KernelDensity:
    """Kernel density of the strain given the position, with the background as its floor.

    .. math:: p(z | x) = (S(x, z) + a\\, b(z)) / (D(x) + a)

    where S is the sum over pairs of position kernel times strain kernel, D the sum of the position kernel
    alone and b the :class:`Background`. ``a`` is :data:`FLOOR` times the D of an evenly spread scan, so that
    the background alone remains where nothing was scanned. ``conditional=False`` is the paper's form with
    constant P(x), where D is that of an evenly spread scan everywhere.

    Parameters
    ----------
    positions, strain : (N, d) m (yaw: rad) and (N, C) V, the training pairs
    position_std, strain_std : (d,) and (C,) kernel widths
    wraps : (d,) bool, axes that are a full turn
    layout : channels of the strain by phalanx
    conditional : whether to divide by D(x)
    evaluation, precision : as for :class:`.KernelSum`
    """

    def __init__(
        self,
        positions: np.ndarray,
        strain: np.ndarray,
        position_std: np.ndarray,
        strain_std: np.ndarray,
        wraps: np.ndarray,
        layout: ChannelLayout,
        *,
        conditional: bool = True,
        evaluation: str = "field",
        precision: str = "float64",
    ) -> None:
        self.background = Background(strain, strain_std, layout)
        self._sums = KernelSum(
            positions, strain, position_std, strain_std, wraps, layout, evaluation, precision
        )
        self._conditional = conditional
        kernel = position_std * math.sqrt(2.0 * math.pi)
        low, high = box(positions)
        self._typical = len(positions) * float(np.prod(kernel / np.maximum(high - low, kernel)))

    def log_density(self, states: np.ndarray, strain: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Log-density (P,) of a strain (C,) of the phalanges ``present`` (F,) at states (P, d)."""
        log_floor = math.log(FLOOR * self._typical) + self.background.log_density(strain, present)

        def at_states(points: np.ndarray) -> np.ndarray:
            return self._mix(*self._sums.at_states(points, strain, present, log_floor), log_floor)

        def on_axes(axes: list[np.ndarray]) -> np.ndarray:
            return self._mix(*self._sums.on_axes(axes, strain, present, log_floor), log_floor)

        if self._sums.evaluation == "field":
            return interpolated(states, self._sums.position_std, at_states, on_axes)
        return at_states(states)

    def _mix(self, sums: np.ndarray, density: np.ndarray, log_scale: float, log_floor: float) -> np.ndarray:
        floor = FLOOR * self._typical
        scanned = (density if self._conditional else self._typical) + floor
        if abs(log_floor - log_scale) < _LARGEST_EXPONENT:
            return np.log((sums + math.exp(log_floor - log_scale)) / scanned) + log_scale
        with np.errstate(divide="ignore"):
            return np.logaddexp(np.log(sums) + log_scale, log_floor) - np.log(scanned)


class SumOfGaussians(MeasurementModel):
    """Kernel density with a Gaussian kernel in state and strain at every training pair (paper, Eq. 4).

    Parameters
    ----------
    scan, scene : training pairs and scene
    position_std : square root of the diagonal of Sigma_x, one number or one per axis, m (yaw: rad)
    strain_std : square root of the diagonal of Sigma_z, one number or one per channel, V
    conditional : divide by the density of the scan in x, correct for an uneven scan; ``False``: the
        paper's joint form with constant P(x)
    evaluation : ``field``, ``truncated`` or ``exact`` (:mod:`.kernels.sums`)
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
        self._density = KernelDensity(
            positions,
            strain,
            positive("position_std", position_std, scene.dimension),
            positive("strain_std", strain_std, self._layout.size),
            scene.wraps,
            self._layout,
            conditional=conditional,
            evaluation=evaluation,
            precision=precision,
        )

    def log_likelihood(
        self, states: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> np.ndarray:
        """See :meth:`MeasurementModel.log_likelihood`."""
        strain, present = checked(strain, self._layout, present)
        return self._density.log_density(states, strain, present)


def training_pairs(scan: Scan, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Positions (N, d) and strains (N, C) of a scan on the axes and phalanges of a scene.

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
    """The given columns; the array itself if they are all of them, so that a large scan is not copied."""
    return array if np.array_equal(columns, np.arange(array.shape[1])) else array[:, columns]
