"""The broad background: what a strain may be when nothing that was scanned explains it."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import gammaln

from tactile_localizer.channels import ChannelLayout

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
    strain : (N, C) the scan's strains, V
    strain_std : (C,) kernel widths, V; a lower limit for the spread, where a scan has too few pairs to tell
    layout : the channels by phalanx; ``None``: the default channels each
    """

    def __init__(
        self, strain: np.ndarray, strain_std: np.ndarray, layout: ChannelLayout | None = None
    ) -> None:
        self.layout = layout or ChannelLayout.default(strain.shape[1])
        self._mean = strain.mean(axis=0)
        self._scale = _SPREAD * np.hypot(_standard_deviation(strain, self._mean), strain_std)
        nu = _DEGREES_OF_FREEDOM
        channels = np.array(self.layout.counts)
        self._halves = (nu + channels) / 2
        constant = gammaln(self._halves) - math.lgamma(nu / 2) - channels / 2 * math.log(nu * math.pi)
        self._constants = constant - self.layout.sum(np.log(self._scale))

    def log_densities(self, strain: np.ndarray) -> np.ndarray:
        """Log-density of each phalanx's strain, (F,), for a strain vector (C,), V."""
        nu = _DEGREES_OF_FREEDOM
        scaled = (strain - self._mean) / self._scale
        # hypot-like scaling is not needed: |scaled| would have to pass 1e154 to overflow.
        return self._constants - self._halves * np.log1p(self.layout.sum(scaled**2) / nu)

    def log_density(self, strain: np.ndarray, present: np.ndarray) -> float:
        """Log-density of the strain (C,) of the phalanges that are ``present`` (F,) bool."""
        if not present.all():
            strain = np.where(self.layout.expand(present), strain, 0.0)
        return float(self.log_densities(strain)[present].sum())


def _standard_deviation(strain: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Of each channel of (N, C), some rows at a time: a large scan is not held twice."""
    total = np.zeros(strain.shape[1])
    for start in range(0, len(strain), _ROWS):
        total += np.sum((strain[start : start + _ROWS] - mean) ** 2, axis=0)
    return np.sqrt(total / len(strain))
