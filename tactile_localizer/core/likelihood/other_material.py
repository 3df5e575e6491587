"""Other material of any strength: the alternative to the map that is as flexible as the map."""

from __future__ import annotations

import math

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core import compiled
from tactile_localizer.core.likelihood.student_t import DEGREES_OF_FREEDOM

_STRENGTHS = np.array([0.0, 0.03, 0.1, 0.3, 1.0, 3.0])
"""Variances of the signal of other material, in those of the map's own signal; zero is featureless."""
PATCH_LENGTH = 0.3
"""Mean length of other material, such as a hem or a label, m: after it the palm is back where it was tracked,
or on material of another strength. By judgement."""


class OtherMaterial:
    """Likelihood of innovations on material that was not scanned, whose signal may have any strength.

    The innovation v of phalanx f has the density sum over g of w_g t_8(v; 0, A I + g S_f), with S_f from the
    covariance of the map's own signal, A the variance of a visit to featureless material, and weights w_g
    that follow the sweep. The eigenvalues of S_f are halfway, geometrically, between those of the signal and
    their mean. One more component is a signal with the largest variance in all directions.

    Parameters
    ----------
    layout : channels of the strain by phalanx
    covariance : (C, C) of the map's signal, a block per phalanx
    variance : (F,) of a visit to featureless material
    """

    def __init__(self, layout: ChannelLayout, covariance: np.ndarray, variance: np.ndarray) -> None:
        self._layout, self._covariance, self._variance = layout, covariance, variance
        self._rotation = np.eye(layout.size)
        even, largest = np.zeros(layout.size), np.zeros(layout.size)
        for own in layout.slices:
            values, self._rotation[own, own] = np.linalg.eigh(covariance[own, own])
            values = np.maximum(values, 0.0)
            # Errors of the map, of even variance, lie in the directions of the signal too: half the shape.
            even[own] = np.sqrt(values * values.mean())
            largest[own] = even[own].max()
        # Last a signal in any direction: strains in another unit are off the map too.
        self._spread = np.vstack([np.outer(_STRENGTHS, even), _STRENGTHS[-1] * largest])
        each = np.full(layout.phalanges, variance, dtype=np.float64)
        self._tables = self._spread, self._rotation, each, layout.bounds

    def transformed(self, transform: np.ndarray) -> OtherMaterial:
        """The same for innovations ``transform @ v``; ``transform`` (C, C) has a block per phalanx."""
        covariance = transform @ self._covariance @ transform.T
        return OtherMaterial(self._layout, covariance, self._variance)

    def start(self) -> np.ndarray:
        """Weights (G, F) of the strengths before the first strain."""
        count = len(self._spread)
        return np.full((count, self._layout.phalanges), 1.0 / count)

    def update(
        self,
        weights: np.ndarray,
        innovation: np.ndarray,
        level_variance: np.ndarray,
        used: np.ndarray,
        travel: float,
        exponent: float,
    ) -> tuple[float, np.ndarray]:
        """Log-likelihood of an innovation, and the weights of the strengths after it.

        Parameters
        ----------
        weights : (G, F) of the strengths, each phalanx's with a sum of one
        innovation : (C,) of a strain from featureless material
        level_variance : (F,) of the level from which it deviates
        used : (F,) bool, phalanges that count
        travel : m since the last update
        exponent : fraction of an independent measurement that the innovation is
        """
        layout, tails = self._layout, DEGREES_OF_FREEDOM
        forgotten = -math.expm1(-travel / PATCH_LENGTH)
        if compiled.MODULE is not None:
            following = np.empty(weights.shape)
            felt = np.ascontiguousarray(weights), innovation, level_variance, used
            rates = tails, exponent, forgotten
            return compiled.MODULE.off_map(*self._tables, *felt, *rates, following), following
        variance = self._spread + layout.expand(self._variance + level_variance)
        squared = np.square(innovation @ self._rotation) / variance
        densities = -0.5 * (tails + layout.widths) * np.log1p(layout.sum(squared) / tails)
        densities -= 0.5 * layout.sum(np.log(variance))
        peak = np.maximum.reduce(densities)
        densities -= peak
        total = np.log(np.add.reduce(weights * np.exp(densities))) + peak
        following = weights * np.exp(exponent * densities)
        following /= np.add.reduce(following)
        following += forgotten * (1.0 / len(weights) - following)
        return float(used @ total), np.where(used, following, weights)
