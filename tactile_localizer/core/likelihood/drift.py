"""Slow difference of a sweep from the scan: a level and a rate that drift along the travel.

Load cells drift, fingers flex and the squeezing force differs, so a strain is compared with the map by its
*innovation*, what a local linear trend (Harvey, 1989) does not predict from the strains before it. The trend
is a linear filter with one gain for all places, so the innovation of the residual is that of the strain less
that of the map, and each trajectory carries only the level and rate of its map.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tactile_localizer.core import compiled
from tactile_localizer.core.likelihood.ancestry import Ancestry

OUTLIER = 100.0
"""Ratio of the energy of an outlier to the largest that is expected. By judgement."""
_LARGEST_GAIN = 1.0 - 1e-9
"""Gain of the first strain of a sweep whose level is unknown: its innovation has a variance of 1e9."""


class Trend(NamedTuple):
    """Levels and rates after some updates; N trajectories, C channels.

    Parameters
    ----------
    measurements : number of independent measurements taken in, (C,) or of all channels
    level, rate : (C,) of the whitened strain, and its change per metre
    of_map : (2, N, C) float32, level and rate of the map along each trajectory
    """

    measurements: np.ndarray | float
    level: np.ndarray
    rate: np.ndarray
    of_map: np.ndarray

    def followed(self, ancestry: Ancestry) -> Trend:
        """The trend along the trajectories that continue these."""
        return Trend(*self[:3], ancestry.followed(self.of_map))

    def updated_where(self, measured: np.ndarray, after: Trend) -> Trend:
        """The trend ``after`` an update for the channels ``measured`` (C,) bool, this one for the others."""
        return Trend(*(np.where(measured, new, old) for new, old in zip(after, self, strict=True)))


class Innovation(NamedTuple):
    """What of a strain, and of the map at N places, their trends do not predict.

    Parameters
    ----------
    of_strain : (C,) whitened strain less its trend
    of_map : (N, C) strain of the map less its trend
    level_variance : (C,) of the level
    turned : (C,) strain of featureless material at the mean yaw, which is not in ``of_strain``
    """

    of_strain: np.ndarray
    of_map: np.ndarray
    level_variance: np.ndarray
    turned: np.ndarray | float = 0.0


class Drift:
    """Filter of the level and rate by which a sweep differs from the scan.

    Parameters
    ----------
    memory : m of travel over which the level is averaged; infinite for a constant
    variance : of a strain about its level
    level_variance : (C,) prior variance of the level; infinite: the level is unknown
    largest_energy : squared length of an innovation from which it is rather an outlier, or the level is

    Attributes
    ----------
    prior : (C,) number of measurements of level zero that the prior counts as
    """

    def __init__(
        self, memory: float, variance: float, level_variance: np.ndarray, largest_energy: float = np.inf
    ) -> None:
        self.memory, self.variance, self._largest_energy = memory, variance, largest_energy
        self.prior = variance / np.maximum(level_variance, 1e-12)

    def start(self, count: int) -> Trend:
        """The trend before the first strain, along ``count`` trajectories."""
        zero = np.zeros(len(self.prior))
        return Trend(0.0, zero, zero, np.zeros((2, count, len(self.prior)), dtype=np.float32))

    def update(
        self,
        trend: Trend,
        whitened: np.ndarray,
        map_strain: np.ndarray,
        travel: float,
        exponent: np.ndarray | float,
        measured: np.ndarray | None = None,
    ) -> tuple[Innovation, Trend]:
        """Innovation of a ``whitened`` strain (C,), where that of the map is ``map_strain`` (N, C) float32.

        ``travel`` is that since the last update, m; ``exponent``, (C,) or of all channels, the fraction of
        an independent measurement that the strain is; ``measured``, (C,) bool, the channels of which there is
        a strain: ``None``, all. The trend of the others stays.
        """
        if measured is not None:
            predicted = trend.level + min(travel, self.memory) * trend.rate
            strain = np.where(measured, whitened, predicted)
            innovation, after = self.update(trend, strain, map_strain, travel, exponent)
            return innovation, trend.updated_where(measured, after)
        if compiled.MODULE is not None:
            return self._compiled(trend, whitened, map_strain, travel, exponent)
        known = trend.measurements + self.prior
        travel = min(travel, self.memory)  # beyond it the level is unknown, however far the arm jumped
        predicted = trend.level + travel * trend.rate
        strain_left = whitened - predicted
        # Whether the strain is an outlier or the level is, the next ones decide: both lose weight.
        weight, rate_gain = 1.0, 0.0
        if np.count_nonzero(known):
            weight = 1.0 / (1.0 + float(strain_left @ strain_left) / self._largest_energy)
            # The first strain sets the level, of which the rate is the change.
            rate_gain = weight * travel / (4.0 * self.memory**2)
        added = exponent * weight
        gain = np.minimum(np.maximum(added / (known + added), weight * travel / self.memory), _LARGEST_GAIN)
        map_level, map_rate = trend.of_map
        map_trend = np.float32(travel) * map_rate
        map_trend += map_level
        map_left = map_strain - map_trend
        following = np.empty_like(trend.of_map)
        np.multiply(map_left, gain.astype(np.float32), out=following[0])
        following[0] += map_trend
        np.multiply(map_left, np.float32(rate_gain), out=following[1])
        following[1] += map_rate
        after = Trend(
            0.5 * (1.0 + weight) * trend.measurements + added,
            predicted + gain * strain_left,
            trend.rate + rate_gain * strain_left,
            following,
        )
        level_variance = self.variance * gain / (1.0 - gain) / exponent
        return Innovation(strain_left, map_left, level_variance), after

    def _compiled(
        self,
        trend: Trend,
        whitened: np.ndarray,
        map_strain: np.ndarray,
        travel: float,
        exponent: np.ndarray | float,
    ) -> tuple[Innovation, Trend]:
        assert compiled.MODULE is not None
        before = np.empty((2, len(self.prior)))
        before[0], before[1] = trend.measurements, exponent
        strain_left, level_variance, measurements, level, rate = after = np.empty((5, len(self.prior)))
        map_left, following = np.empty_like(map_strain), np.empty_like(trend.of_map)
        model = self.memory, self.variance, self._largest_energy
        of_strain = before[0], trend.level, trend.rate, self.prior, whitened, before[1]
        compiled.MODULE.drift(
            *of_strain, *model, travel, map_strain, trend.of_map, *after, map_left, following
        )
        return Innovation(strain_left, map_left, level_variance), Trend(measurements, level, rate, following)

    def along(self, values: np.ndarray, pitch: float, exponent: float) -> tuple[np.ndarray, np.ndarray]:
        """Innovations of ``values`` (n, C) at every ``pitch`` metres, and variances of the level, (n, C)."""
        nowhere = np.zeros((0, values.shape[1]), dtype=np.float32)
        trend, found, variance = self.start(0), np.zeros_like(values), np.zeros_like(values)
        for row, value in enumerate(values):
            innovation, trend = self.update(trend, value, nowhere, pitch, exponent)
            found[row], variance[row] = innovation.of_strain, innovation.level_variance
        return found, variance


def innovations(values: np.ndarray, memory: float, pitch: float, robust: bool = False) -> np.ndarray:
    """Innovations (n, C) of ``values`` (n, C) at every ``pitch`` metres of a sweep whose level is unknown.

    The first one is zero. With ``robust``, a step that is large compared with the noise begins a new level.
    """
    count, channels = values.shape
    typical_step, largest = np.ones(channels), np.inf
    if robust and count > 1:
        # Values that do not change, as differences of whole counts, have the steps of their digits.
        digits = np.finfo(np.float64)
        smallest = np.maximum(digits.eps * np.abs(values).max(axis=0), digits.tiny)
        typical_step = np.maximum(np.median(np.abs(np.diff(values, axis=0)), axis=0), smallest)
        largest = OUTLIER * channels
    drift = Drift(memory, 1.0, np.full(channels, np.inf), largest)
    found = drift.along(values / typical_step, pitch, 1.0)[0] * typical_step
    found[:1] = 0.0
    return found
