"""The broad background: what a strain may be when nothing that was scanned explains it."""

from __future__ import annotations

import math

import numpy as np

from tactile_localizer.scene import GAUGES

_DEGREES_OF_FREEDOM = 3.0
_SPREAD = 2.0
_ROWS = 2**12


class Background:
    """A wide Student-t density over the strain of each phalanx, independent of the state.

    Centred on the scan's mean with twice its spread and three degrees of freedom: heavy tails keep its
    logarithm finite and slowly falling a million sigma away, so a measurement unlike everything is
    explained by the background, at every state alike, and teaches nothing.

    Parameters
    ----------
    strain : (N, 8F) the scan's strains, V
    strain_std : (8F,) kernel widths, V; a lower limit for the spread, where a scan has too few pairs to tell
    """

    def __init__(self, strain: np.ndarray, strain_std: np.ndarray) -> None:
        self._mean = strain.mean(axis=0)
        self._scale = _SPREAD * np.hypot(_standard_deviation(strain, self._mean), strain_std)
        nu = _DEGREES_OF_FREEDOM
        constant = math.lgamma((nu + GAUGES) / 2) - math.lgamma(nu / 2) - GAUGES / 2 * math.log(nu * math.pi)
        self._constants = constant - np.log(self._scale).reshape(-1, GAUGES).sum(axis=1)

    def log_densities(self, strain: np.ndarray) -> np.ndarray:
        """Log-density of each phalanx's strain, (F,), for a strain vector (8F,), V."""
        nu = _DEGREES_OF_FREEDOM
        scaled = ((strain - self._mean) / self._scale).reshape(-1, GAUGES)
        # hypot-like scaling is not needed: |scaled| would have to pass 1e154 to overflow.
        return self._constants - (nu + GAUGES) / 2 * np.log1p(np.sum(scaled**2, axis=1) / nu)

    def log_density(self, strain: np.ndarray, present: np.ndarray) -> float:
        """Log-density of the strain (8F,) of the phalanges that are ``present`` (F,) bool."""
        if not present.all():
            strain = np.where(np.repeat(present, GAUGES), strain, 0.0)
        return float(self.log_densities(strain)[present].sum())


def _standard_deviation(strain: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Of each channel of (N, C), some rows at a time: a large scan is not held twice."""
    total = np.zeros(strain.shape[1])
    for start in range(0, len(strain), _ROWS):
        total += np.sum((strain[start : start + _ROWS] - mean) ** 2, axis=0)
    return np.sqrt(total / len(strain))
