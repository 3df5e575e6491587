"""Background density of strains that nothing in the scan explains."""

import math

import numpy as np
from scipy.special import gammaln

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.likelihood.student_t import DEGREES_OF_FREEDOM

FLOOR = 0.01
"""Weight of the background in a mixture with a model, relative to the model."""
_SPREAD = 2.0


class Background:
    """Wide Student-t density over the strain of each phalanx, independent of the state.

    It is centred on the scan's mean, with twice its spread. Its heavy tails fall slowly even a million sigma
    away, so that an outlier is explained by the background equally at every state and does not change the
    belief.

    Parameters
    ----------
    strain : (N, C) strains of the scan, V
    strain_std : (C,) kernel widths, V; a lower limit of the spread, for scans with few pairs
    layout : channels of the strain by phalanx
    """

    def __init__(self, strain: np.ndarray, strain_std: np.ndarray, layout: ChannelLayout) -> None:
        self.layout = layout
        self._mean = strain.mean(axis=0)
        self._scale = _SPREAD * np.hypot(strain.std(axis=0), strain_std)
        nu = DEGREES_OF_FREEDOM
        channels = layout.widths
        self._halves = (nu + channels) / 2
        constant = gammaln(self._halves) - math.lgamma(nu / 2) - channels / 2 * math.log(nu * math.pi)
        self._constants = constant - self.layout.sum(np.log(self._scale))

    def log_density(self, strain: np.ndarray, present: np.ndarray) -> float:
        """Log-density of a strain (C,), V, zero for absent phalanges, of those ``present`` (F,) bool."""
        squared = self.layout.sum(((strain - self._mean) / self._scale) ** 2)
        log_densities = self._constants - self._halves * np.log1p(squared / DEGREES_OF_FREEDOM)
        return float(log_densities[present].sum())

    def mixed(self, log_density: np.ndarray, strain: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Log-densities (P,) of a model, mixed with the background by :data:`FLOOR`."""
        background = math.log(FLOOR) + self.log_density(strain, present)
        return np.logaddexp(log_density, background) - math.log1p(FLOOR)
