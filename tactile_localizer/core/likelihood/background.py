"""Background density of strains that nothing in the scan explains."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import gammaln

from tactile_localizer.channels import ChannelLayout

FLOOR = 0.01
"""Weight of the background in a mixture with a model, relative to the model."""
_DEGREES_OF_FREEDOM = 3.0
_SPREAD = 2.0
_ROWS = 2**12


class Background:
    """Wide Student-t density over the strain of each phalanx, independent of the state.

    It is centred on the scan's mean, with twice its spread and three degrees of freedom. Its heavy tails fall
    slowly even a million sigma away, so that an outlier is explained by the background equally at every
    state and does not change the belief.

    Parameters
    ----------
    strain : (N, C) strains of the scan, V
    strain_std : (C,) kernel widths, V; a lower limit of the spread, for scans with few pairs
    layout : channels of the strain by phalanx
    """

    def __init__(self, strain: np.ndarray, strain_std: np.ndarray, layout: ChannelLayout) -> None:
        self.layout = layout
        self._mean = strain.mean(axis=0)
        self._scale = _SPREAD * np.hypot(_standard_deviation(strain, self._mean), strain_std)
        nu = _DEGREES_OF_FREEDOM
        channels = layout.widths
        self._halves = (nu + channels) / 2
        constant = gammaln(self._halves) - math.lgamma(nu / 2) - channels / 2 * math.log(nu * math.pi)
        self._constants = constant - self.layout.sum(np.log(self._scale))

    def log_densities(self, strain: np.ndarray) -> np.ndarray:
        """Log-densities (F,) of the phalanges' strains in a strain vector (C,), V."""
        scaled = (strain - self._mean) / self._scale
        return self._constants - self._halves * np.log1p(self.layout.sum(scaled**2) / _DEGREES_OF_FREEDOM)

    def log_density(self, strain: np.ndarray, present: np.ndarray) -> float:
        """Log-density of the strain (C,) of the phalanges that are ``present`` (F,) bool."""
        if not present.all():
            strain = np.where(self.layout.expand(present), strain, 0.0)
        return float(self.log_densities(strain)[present].sum())

    def mixed(self, log_density: np.ndarray, strain: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Log-densities (P,) of a model, mixed with the background by :data:`FLOOR`."""
        background = math.log(FLOOR) + self.log_density(strain, present)
        return np.logaddexp(log_density, background) - math.log1p(FLOOR)


def _standard_deviation(strain: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Standard deviations (C,) of (N, C), some rows at a time: a large scan is not copied."""
    total = np.zeros(strain.shape[1])
    for start in range(0, len(strain), _ROWS):
        total += np.sum((strain[start : start + _ROWS] - mean) ** 2, axis=0)
    return np.sqrt(total / len(strain))
