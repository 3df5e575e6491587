"""The measurement model with featureless regions apart (paper, III-D, Eq. 5 to 7)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.geometry.phalanges import phalanx_positions
from tactile_localizer.core.likelihood.base import MeasurementModel, checked, positive
from tactile_localizer.core.likelihood.kernels.interpolation import interpolated
from tactile_localizer.core.likelihood.kernels.normal import Normal
from tactile_localizer.core.likelihood.sum_of_gaussians import FLOOR, PhalanxKernels, dtype_of, training_pairs
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import SceneError
from tactile_localizer.scene import Phalanx, Scene


class Featureless(MeasurementModel):
    """A product over phalanges: a sum of Gaussians on the feature, one Gaussian off it.

    The position of phalanx f is a_f, its offset from the palm turned by yaw; whether it is on the feature is
    decided by where *it* is, and its training pairs are placed by where it was. Both branches are densities
    over the phalanx's strain on the same scale and with the same blur: the sum of Gaussians in its
    conditional form, whose kernels have the variance S_z, and one Gaussian whose covariance is that of the
    featureless strains plus S_z. Without the latter, featureless strains would be likelier off the feature
    than on it, and push the belief out of the region. Both have the broad background as their floor.

    Parameters
    ----------
    scan, scene : the training pairs and what is modelled; the scene gives the feature's region
    position_std, strain_std : kernel widths, one number or one an axis (m, yaw: rad) and one a channel (V)
    evaluation, precision : as for :class:`~.sum_of_gaussians.SumOfGaussians`

    Raises
    ------
    SceneError
        The scene gives no region, or all pairs of a phalanx are on one side of it.
    """

    def __init__(
        self,
        scan: Scan,
        scene: Scene,
        position_std: Any,
        strain_std: Any,
        evaluation: str = "field",
        precision: str = "float64",
    ) -> None:
        if scene.feature is None:
            raise SceneError(
                f"scene {scene.name}: expected a feature region for the model featureless, found none"
            )
        positions, strain = training_pairs(scan, scene)
        position_std = positive("position_std", position_std, scene.dimension)
        strain_std = positive("strain_std", strain_std, strain.shape[1])
        self._position_std = position_std
        self._evaluation = evaluation
        self._phalanges = []
        self._layout = scene.layout
        for phalanx, columns in zip(scene.phalanges, self._layout.slices, strict=True):
            places = phalanx_positions(scene, phalanx, positions)
            kernels = PhalanxKernels(
                places,
                strain[:, columns],
                position_std,
                strain_std[columns],
                scene.wraps,
                evaluation=evaluation,
                dtype=dtype_of(precision),
                layout=ChannelLayout((phalanx.channels,)),
            )
            off = _off_feature(places, strain[:, columns], strain_std[columns], scene, phalanx.name)
            self._phalanges.append(_PhalanxModel(scene, phalanx, kernels, off))

    def log_likelihood(
        self, states: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> np.ndarray:
        """See :meth:`MeasurementModel.log_likelihood`."""
        strain, present = checked(strain, self._layout, present)
        total = np.zeros(len(states))
        for phalanx, own in self._present(strain, present):
            total += phalanx.at_states(states, own, self._evaluation == "field")
        return total

    def _present(self, strain: np.ndarray, present: np.ndarray) -> list[tuple[_PhalanxModel, np.ndarray]]:
        return [
            (phalanx, own)
            for phalanx, own, here in zip(self._phalanges, self._layout.split(strain), present, strict=True)
            if here
        ]


class _PhalanxModel:
    """P(z^f | a_f) of one phalanx: Eq. 7 off the feature, the conditional form of Eq. 4 on it."""

    _PRESENT = np.ones(1, dtype=bool)

    def __init__(self, scene: Scene, phalanx: Phalanx, kernels: PhalanxKernels, off: Normal) -> None:
        assert scene.feature is not None
        self._scene, self._phalanx, self._region = scene, phalanx, scene.feature
        self._kernels, self._off = kernels, off

    def at_states(self, states: np.ndarray, strain: np.ndarray, field: bool) -> np.ndarray:
        positions = phalanx_positions(self._scene, self._phalanx, states)
        total = np.full(len(states), self._log_off(strain))
        on = self._region.contains(positions)
        if on.any():
            total[on] = self._on_feature(positions[on], strain, field)
        return total

    def _on_feature(self, positions: np.ndarray, strain: np.ndarray, field: bool) -> np.ndarray:
        def at_states(points: np.ndarray) -> np.ndarray:
            return self._kernels.at_states(points, strain, self._PRESENT)

        def on_axes(axes: list[np.ndarray]) -> np.ndarray:
            return self._kernels.on_axes(axes, strain, self._PRESENT)

        if not field:
            return at_states(positions)
        return interpolated(positions, self._kernels.kernels.position_std, at_states, on_axes)

    def _log_off(self, strain: np.ndarray) -> float:
        background = self._kernels.background.log_density(strain, self._PRESENT)
        return float(
            np.logaddexp(self._off.log_density(strain), math.log(FLOOR) + background) - math.log1p(FLOOR)
        )


def _off_feature(
    positions: np.ndarray, strain: np.ndarray, strain_std: np.ndarray, scene: Scene, name: str
) -> Normal:
    """The Gaussian over all strains that a phalanx felt off the feature (Eq. 7), blurred as those on it."""
    assert scene.feature is not None
    off = ~scene.feature.contains(positions)
    if off.all() or np.count_nonzero(off) <= strain.shape[1]:
        side = "inside" if not off.all() else "outside"
        raise SceneError(
            f"scene {scene.name}: expected pairs of phalanx {name} on both sides of the feature region, "
            f"all are {side}"
        )
    fitted = Normal.fitted(strain[off])
    return Normal(fitted.mean, fitted.covariance + np.diag(strain_std**2))
