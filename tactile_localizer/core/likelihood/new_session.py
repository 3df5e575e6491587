"""Model of a session other than the scan's, in which strains have an unknown offset and gain.

Load cells drift between power-ups, and strains grow with the squeezing force. If the scanned material has
features everywhere, the offset can only be observed when the position is known. It is therefore estimated
along each trajectory of the filter, a cell that moves with the palm or a particle (Rao-Blackwellization;
Doucet, de Freitas, Murphy and Russell, 2000). Given the trajectory, strains are a linear regression on the
expected ones. The offset has a vague normal prior, the gain a normal prior about 1, and the residual's scale
an inverse gamma prior about that of the scan.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.likelihood.evaluation import INFLATION, Evaluation
from tactile_localizer.core.likelihood.noise_model import NoiseModel
from tactile_localizer.core.likelihood.strain_map import StrainMap
from tactile_localizer.core.likelihood.student_t import DEGREES_OF_FREEDOM, location_weight, log_density
from tactile_localizer.core.likelihood.weights import MAX_LOG_ODDS, log_sum, normalize

NEW_SESSION = 0.3
"""Prior probability of another session. By judgement: with 0.1 a fabric at another force took 58 to 80 mm
to converge, with 0.5 it took 48 to 56 mm (Linen), but one in the scan's own session 21 mm instead of 15
(BeigeCotton)."""
_PRIOR_LOG_ODDS = math.log(NEW_SESSION / (1.0 - NEW_SESSION))
OFFSET_VARIANCE = 1e4
"""Prior variance of a channel's offset, in noise variances. With 100 a fabric at another force was found in 7
of 8 starts, with 1,000 and 10,000 in all (Linen)."""
GAIN_STD = 0.2
GAIN_RANGE = (0.6, 1.7)
"""Prior standard deviation and range of the gain of a phalanx. Linen at 210 N on a map at 250 N has a gain of
0.8, the reverse 1.2. The range excludes a gain of zero, with which any place explains any material."""
_MEMORY = 1.0
"""m of travel over which the weight of a measurement falls to 1/e, because offsets drift. By judgement, not
varied."""
_NEGLIGIBLE = 1e-5
"""Probability of another session below which it is not evaluated."""
_SCATTERS = 0.5 * 2.0 ** np.arange(8)
"""Variances of unknown material about its mean, relative to that of a visit."""


class _Sums(NamedTuple):
    """Weighted sums along P trajectories, of the residual r and of the expected strain m.

    Parameters
    ----------
    r, m : (P, C)
    weight, mm, mr : (P, F)
    samples, squared : (P, F) number of independent residuals, and sum of their squares in predicted variances
    log_odds : (P, 1) increase of the log-odds of another session to that of the scan
    """

    r: np.ndarray
    m: np.ndarray
    weight: np.ndarray
    mm: np.ndarray
    mr: np.ndarray
    samples: np.ndarray
    squared: np.ndarray
    log_odds: np.ndarray


class NewSession:
    """Likelihoods of strains in the scan's session or another one, with statistics of each trajectory.

    Parameters
    ----------
    noise : noise model, which whitens strains
    strain_map : tables of expected strain and variance, of which the first component is used
    length : m of travel per independent measurement. Neighbouring places resemble each other, so that over a
        shorter distance any material can be fitted by an offset and a gain
    """

    def __init__(self, noise: NoiseModel, strain_map: StrainMap, length: float) -> None:
        self._noise, self._map, self.length = noise, strain_map, length
        self._layout = noise.layout
        self._counts = self._layout.widths
        # A product with these columns sums over the channels of each phalanx, faster than ChannelLayout.sum.
        self._columns = self._layout.expand(np.eye(len(self._counts))).T
        sizes = [self._layout.size] * 2 + [len(self._counts)] * 5 + [1]
        self._width, self._ends = sum(sizes), np.cumsum(sizes)[:-1]
        self._unknown = _UnknownMaterial(self._layout, float(strain_map.variance.mean()))
        self._carried: np.ndarray | None = None
        self.reset()

    def reset(self) -> None:
        """Return to the prior."""
        self._probability = NEW_SESSION
        self._forget()

    def returned(self, fraction: float) -> None:
        """Return this fraction of the probability to the prior, for belief that was injected on the map."""
        self._probability += fraction * (NEW_SESSION - self._probability)

    @property
    def is_possible(self) -> bool:
        """Whether another session is probable enough to be worth evaluating."""
        return self._probability > _NEGLIGIBLE

    def evaluate(
        self,
        ancestors: tuple[np.ndarray, np.ndarray],
        log_prior: np.ndarray,
        same: Evaluation,
        strain: np.ndarray,
        used: np.ndarray,
        exponents: tuple[float, float],
        travel: float,
    ) -> np.ndarray:
        """Tempered log-likelihood ratios (P,) of each state to unknown material, averaged over the sessions.

        Updates the estimates of offset and gain, and the odds of the sessions.

        Parameters
        ----------
        ancestors : of the states, see :meth:`.BayesFilter.ancestors`
        log_prior : (P,) of the states
        same : evaluation of the strain in the session of the scan
        strain : (C,) whitened
        used : (F,) bool, phalanges that count
        exponents : tempering exponents in the session of the scan and in another one
        travel : m since the last strain
        """
        index, continued = ancestors
        if self._carried is None:
            carried, continued = np.zeros((len(index), self._width)), np.zeros(len(index))
        else:
            carried = self._carried[index]
        carried *= continued[:, None]
        # Injected belief has the odds of the sessions that the rest of the belief has.
        carried[:, -1] += (1.0 - continued) * (_log_odds(self._probability) - _PRIOR_LOG_ODDS)
        sums = _Sums(*np.split(carried, self._ends, axis=1))
        volume = float(self._noise.log_volume[used].sum())
        mean = self._map.mean[same.nodes, 0].astype(np.float64)
        variance = self._map.variance[same.nodes, 0].astype(np.float64)
        residual = strain - mean
        moved, inflated, squared = self._densities(sums, mean, variance, residual, used)
        log_odds = _PRIOR_LOG_ODDS + sums.log_odds[:, 0]
        log_same = -np.logaddexp(0.0, log_odds)
        log_new = log_same + log_odds
        in_scan, in_another = exponents
        # Unknown material is given an offset as well: otherwise the more flexible model would always win.
        with_offset = unknown(log_prior + log_new, inflated, self._unknown.update(strain, used, in_another))
        without = unknown(log_prior + log_same, same.other_material, same.elsewhere)
        either = np.logaddexp(with_offset + volume, without) - math.log(2.0)
        moved = in_another * (moved + volume - either)
        stayed = in_scan * (same.same_material - either)
        ratios = np.logaddexp(log_same + stayed, log_new + moved)
        log_another = log_sum(log_prior + log_new + moved) - log_sum(log_prior + ratios)
        self._probability = math.exp(min(log_another, 0.0))
        robust = location_weight(squared, self._counts) * (in_another * used)
        weight = robust / variance
        each = self._layout.expand(weight)
        new = _Sums(
            r=each * residual,
            m=each * mean,
            weight=weight,
            mm=(each * mean**2) @ self._columns,
            mr=(each * mean * residual) @ self._columns,
            samples=np.broadcast_to(in_another * used * self._counts, weight.shape),
            squared=robust * squared,
            log_odds=(moved - stayed)[:, None],
        )
        carried = (carried + np.concatenate(new, axis=1)) * math.exp(-travel / _MEMORY)
        carried[:, -1:] = carried[:, -1:].clip(-MAX_LOG_ODDS, MAX_LOG_ODDS)
        self._carried = carried
        if not self.is_possible:
            self._forget()
        return ratios

    def _forget(self) -> None:
        self._carried = None
        self._unknown.reset()

    def _densities(
        self, sums: _Sums, mean: np.ndarray, variance: np.ndarray, residual: np.ndarray, used: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Log-densities of a strain in another session.

        Returns
        -------
        plain, inflated : (P,) with the predicted variance and with a larger one
        squared : (P, F) squared residuals in units of the predicted variance
        """
        layout = self._layout
        offset_variance = 1.0 / (sums.weight + 1.0 / OFFSET_VARIANCE)
        each = layout.expand(offset_variance)
        offset, centre = sums.r * each, sums.m * each
        columns = self._columns
        gain_variance = 1.0 / (1.0 / GAIN_STD**2 + sums.mm - (sums.m * centre) @ columns)
        gain = 1.0 + (sums.mr - (sums.m * offset) @ columns) * gain_variance
        direction = mean - centre
        left = residual - offset - layout.expand(gain.clip(*GAIN_RANGE) - 1.0) * direction
        rr, dd, rd = left**2 @ columns, direction**2 @ columns, (left * direction) @ columns

        def density(factor: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
            # The gain adds variance in one direction: inverse and determinant by Sherman and Morrison.
            isotropic = factor * variance + offset_variance
            along = isotropic + gain_variance * dd
            squared = np.maximum(rr - gain_variance * rd**2 / along, 0.0)
            own = log_density(squared, isotropic, self._counts) - 0.5 * np.log(along / isotropic)
            return own @ used, squared / isotropic

        scale = (DEGREES_OF_FREEDOM + sums.squared) / (DEGREES_OF_FREEDOM + sums.samples)
        return density(scale)[0], density(INFLATION)[0], density(1.0)[1]


class _UnknownMaterial:
    """Student-t distribution of the strains of unknown material, with unknown mean and variance."""

    def __init__(self, layout: ChannelLayout, noise: float) -> None:
        self._layout, self._variances = layout, noise * _SCATTERS
        self._counts = layout.widths
        self.reset()

    def reset(self) -> None:
        """Return to the prior."""
        count = len(self._variances)
        self._log_weights = np.full(count, -math.log(count))
        self._weight = np.zeros((count, self._layout.phalanges))
        self._sum = np.zeros((count, self._layout.size))

    def update(self, strain: np.ndarray, used: np.ndarray, exponent: float) -> float:
        """Log-density of a strain given the previous ones; then the estimates are updated by it."""
        mean_variance = 1.0 / (self._weight + 1.0 / OFFSET_VARIANCE)
        residual = strain - self._sum * self._layout.expand(mean_variance)
        squared = self._layout.sum(residual**2)
        variance = self._variances[:, None] + mean_variance
        densities = log_density(squared, variance, self._counts) @ used
        weight = location_weight(squared / variance, self._counts) * (exponent * used)
        weight /= self._variances[:, None]
        self._weight += weight
        self._sum += self._layout.expand(weight) * strain
        found = log_sum(self._log_weights + densities)
        # Bounded below, because a variance that does not fit now may fit later.
        log_weights = np.maximum(self._log_weights + exponent * densities - found, -MAX_LOG_ODDS)
        self._log_weights = normalize(log_weights)[0]
        return found


def unknown(log_prior: np.ndarray, other: np.ndarray, elsewhere: float) -> float:
    """Log-likelihood of unknown material: half resembles the places of the belief, half any place."""
    here = log_sum(log_prior + other) - log_sum(log_prior)
    return float(np.logaddexp(here, elsewhere)) - math.log(2.0)


def _log_odds(probability: float) -> float:
    odds = probability / max(1.0 - probability, 1e-6)
    return math.log(odds)
