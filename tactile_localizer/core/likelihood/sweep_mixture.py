"""The sweep mixture: a place feels as an interpolation between two sweeps on either side of it."""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp

from tactile_localizer.core.likelihood.evaluation import Evaluation
from tactile_localizer.core.likelihood.noise_model import NoiseModel
from tactile_localizer.core.likelihood.slow_residual import Filtering
from tactile_localizer.core.likelihood.strain_map import StrainMap, VarianceModel
from tactile_localizer.core.likelihood.student_t import log_density, robust_weight

INFLATION = 9.0
"""Factor of the variance under which a strain fits unknown material. By judgement (three standard
deviations); tried on two fabrics and three simulated features."""
INFORMATION_LENGTH = 0.003
"""m of travel between two independent measurements of the position, innovations though they are: the map's
own errors recur from strain to strain. By judgement; 1.7 and 3 mm were tried on two
fabrics and one simulated feature."""
_ELSEWHERE_PLACES = 400
"""Places that stand for the whole map in the likelihood of a strain that was felt anywhere."""


class SweepMixture:
    """Student-t mixture over interpolated pairs of sweeps, with memory along the sweep.

    Parameters
    ----------
    noise : coordinates in which a visit's noise is white
    strain_map : tables of expectation and variance
    variance : course of the residual along the travel
    cell : (d,) size of a grid filter's cells, for which the tables were made, m (yaw: rad)
    """

    def __init__(
        self, noise: NoiseModel, strain_map: StrainMap, variance: VarianceModel, cell: np.ndarray
    ) -> None:
        self.noise, self.map, self.variance, self.cell = noise, strain_map, variance, cell
        self.log_components = np.log(np.exp(strain_map.log_prior).mean(axis=0))
        self.channels = noise.layout.size
        self.information_length = INFORMATION_LENGTH
        self.presence_length = max(3.0 * INFORMATION_LENGTH, 1.5 * variance.summed_correlation)
        self.offset_variance = noise.offset_variance
        count = len(strain_map.mean)
        places = np.linspace(0, count - 1, min(count, _ELSEWHERE_PLACES)).astype(np.intp)
        self._places = tuple(table[places] for table in (strain_map.mean, strain_map.variance))
        self._places_prior = strain_map.log_prior[places] - np.log(len(places))

    def whitened(self, strain: np.ndarray) -> np.ndarray:
        """A strain (C,), V, in the coordinates that :meth:`evaluate` takes."""
        return self.noise.whitened(strain)

    def in_volts(self, difference: np.ndarray) -> np.ndarray:
        """A difference of whitened strains (C,) in V."""
        return np.asarray(np.linalg.solve(self.noise.whitening, difference))

    def evaluate(
        self,
        states: np.ndarray,
        memory: np.ndarray,
        strain: np.ndarray,
        used: np.ndarray,
        filtering: Filtering,
        offset_variance: np.ndarray,
    ) -> Evaluation:
        """Log-likelihoods of a whitened ``strain`` (C,) at ``states`` (P, d).

        Parameters
        ----------
        memory : (P, K, C) of each hypothesis, after the last strain
        used : (F,) bool, phalanges that count
        filtering : of the slow part of the residual, for the travel since the last strain
        offset_variance : (F,) of what is not known of the sweep's offset, whitened
        """
        nodes = self.map.nearest(states)
        strain = strain.astype(np.float32)
        unknown = offset_variance.astype(np.float32)
        variance = self.map.variance[nodes] + unknown
        residual = strain - self.map.mean[nodes]
        marginal, inflated = self._densities(residual, variance)
        position = np.zeros(residual.shape[:2])
        predicted = memory * np.float32(filtering.decay)
        innovation = residual - predicted
        updated = predicted
        for index, own in enumerate(self.noise.layout.slices):
            if not used[index]:
                continue
            part = innovation[..., own]
            squared = np.einsum("pkc,pkc->pk", part, part)
            scale = self.map.variance[nodes, :, index] * np.float32(filtering.innovation_variance)
            scale += unknown[index]
            channels = own.stop - own.start
            position += log_density(squared, scale, channels)
            gain = np.float32(filtering.gain) * robust_weight(squared, scale, channels)
            updated[..., own] += gain[..., None] * part
        elsewhere = self._elsewhere(strain, unknown, used)
        return Evaluation(
            position,
            marginal,
            inflated,
            elsewhere,
            self.map.log_prior[nodes],
            residual,
            variance,
            updated,
        )

    def _densities(self, residual: np.ndarray, variance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Log-densities (P, K, F) of residuals, and with inflated variance."""
        counts = np.array(self.noise.layout.counts, dtype=np.float32)
        squared = np.stack(
            [np.einsum("pkc,pkc->pk", part, part) for part in self.noise.layout.split(residual)], axis=-1
        )
        volume = self.noise.log_volume.astype(np.float32)
        plain = log_density(squared, variance, counts) + volume  # type: ignore[arg-type]
        wide = log_density(squared, np.float32(INFLATION) * variance, counts) + volume  # type: ignore[arg-type]
        return plain, wide

    def _elsewhere(self, strain: np.ndarray, offset_variance: np.ndarray, used: np.ndarray) -> float:
        mean, variance = self._places
        _, inflated = self._densities(strain - mean, variance + offset_variance)
        prior = self._places_prior
        return float(logsumexp(prior + inflated[..., used].sum(axis=-1)))
