"""A measurement model of one's own: the nearest training pair, with heavy tails."""

import math

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import gammaln

from tactile_localizer.core.likelihood.base import MeasurementModel, checked, training_pairs
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.paper.kernel_widths import kernel_widths
from tactile_localizer.scene import Scene

FREEDOM = 4.0
"""Degrees of freedom; fewer give less weight to outliers."""


class NearestStudent(MeasurementModel):
    """Each phalanx's strain has a Student-t density about the strain of the nearest training pair."""

    def __init__(self, scan: Scan, scene: Scene) -> None:
        positions, self._strain = training_pairs(scan, scene)
        self._position_std, self._strain_std = kernel_widths(scan, scene)
        self._tree = cKDTree(positions / self._position_std)
        self._layout = scene.layout
        channels = np.array(self._layout.counts)
        self._half = 0.5 * (FREEDOM + channels)
        constant = gammaln(self._half) - gammaln(0.5 * FREEDOM) - 0.5 * channels * math.log(FREEDOM * math.pi)
        self._constants = constant - self._layout.sum(np.log(self._strain_std))

    def log_likelihood(
        self, states: np.ndarray, strain: np.ndarray, present: np.ndarray | None = None
    ) -> np.ndarray:
        """Log-density of ``strain`` (C,), V, of the phalanges ``present`` at ``states`` (P, d): (P,)."""
        strain, present = checked(strain, self._layout, present)
        _, nearest = self._tree.query(states / self._position_std)
        scaled = (strain - self._strain[nearest]) / self._strain_std
        squared = self._layout.sum(scaled**2)
        log_densities = self._constants - self._half * np.log1p(squared / FREEDOM)
        return log_densities[:, present].sum(axis=1)
