"""Measurement model with separate featureless regions (paper, III-D, Eq. 5 to 7)."""

import math
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.geometry.phalanges import phalanx_positions
from tactile_localizer.core.likelihood.base import MeasurementModel, checked, training_pairs
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import SceneError
from tactile_localizer.paper.gaussian import ridge
from tactile_localizer.paper.kernel_density import KernelDensity
from tactile_localizer.paper.kernel_widths import kernel_widths
from tactile_localizer.scene import Phalanx, Scene


class Featureless(MeasurementModel):
    """Product over phalanges of a sum of Gaussians on the feature and a single Gaussian off it.

    Whether phalanx f is on the feature is decided by its own position a_f, the palm's position plus its
    offset turned by yaw; its training pairs are at its own positions too. Both branches are densities over
    the strain of the phalanx with the same blur: the kernels of the sum of Gaussians, in its conditional
    form, have the variance S_z, and the covariance of the single Gaussian is that of the featureless strains
    plus S_z. Without the latter, featureless strains would be more likely off the feature than on it. Both
    branches have the background as their floor.

    Parameters
    ----------
    scan, scene : training pairs and scene, which gives the feature's region
    position_std : kernel width in position, one number or one per axis, m (yaw: rad); ``None``: chosen
    strain_std : kernel width in strain, one number or one per channel, V; ``None``: chosen from the scan

    Raises
    ------
    ParameterError
        A width out of its range, or a lattice too large for the memory.
    SceneError
        The scene gives no region, or all pairs of a phalanx are on one side of it.
    """

    def __init__(self, scan: Scan, scene: Scene, position_std: Any = None, strain_std: Any = None) -> None:
        if scene.feature is None:
            raise SceneError(
                f"scene {scene.name}: expected a feature region for the model featureless, found none"
            )
        positions, strain = training_pairs(scan, scene)
        position_std, strain_std = kernel_widths(scan, scene, position_std, strain_std)
        self._layout = scene.layout
        self._phalanges = [
            _PhalanxModel(scene, phalanx, positions, strain[:, columns], position_std, strain_std[columns])
            for phalanx, columns in zip(scene.phalanges, self._layout.slices, strict=True)
        ]

    def log_likelihood(
        self, states: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> np.ndarray:
        """See :meth:`MeasurementModel.log_likelihood`."""
        strain, present = checked(strain, self._layout, present)
        total = np.zeros(len(states))
        for model, own, here in zip(self._phalanges, self._layout.split(strain), present, strict=True):
            if here:
                total += model.log_likelihood(states, own)
        return total


class _PhalanxModel:
    """P(z^f | a_f) of one phalanx: Eq. 7 off the feature, the conditional form of Eq. 4 on it."""

    _PRESENT = np.ones(1, dtype=bool)

    def __init__(
        self,
        scene: Scene,
        phalanx: Phalanx,
        palms: np.ndarray,
        strain: np.ndarray,
        position_std: np.ndarray,
        strain_std: np.ndarray,
    ) -> None:
        assert scene.feature is not None
        self._scene, self._phalanx, self._region = scene, phalanx, scene.feature
        positions = phalanx_positions(scene, phalanx, palms)
        off = strain[~scene.feature.contains(positions)]
        if len(off) == len(strain) or len(off) <= strain.shape[1]:
            side = "outside" if len(off) == len(strain) else "inside"
            raise SceneError(
                f"scene {scene.name}: expected pairs of phalanx {phalanx.name} on both sides of the feature "
                f"region, all are {side}"
            )
        self._mean, covariance = off.mean(axis=0), np.atleast_2d(np.cov(off.T, bias=True))
        self._factor = np.linalg.cholesky(covariance + ridge(covariance, off) + np.diag(strain_std**2))
        self._log_constant = -0.5 * len(covariance) * math.log(2.0 * math.pi)
        self._log_constant -= float(np.log(np.diag(self._factor)).sum())
        layout = ChannelLayout((phalanx.channels,))
        self._kernels = KernelDensity(positions, strain, position_std, strain_std, scene.wraps, layout)

    def log_likelihood(self, states: np.ndarray, strain: np.ndarray) -> np.ndarray:
        white = solve_triangular(self._factor, strain - self._mean, lower=True)
        off = np.array([self._log_constant - 0.5 * white @ white])
        total = np.repeat(self._kernels.background.mixed(off, strain, self._PRESENT), len(states))
        positions = phalanx_positions(self._scene, self._phalanx, states)
        on = self._region.contains(positions)
        if on.any():
            total[on] = self._kernels.log_density(positions[on], strain, self._PRESENT)
        return total
