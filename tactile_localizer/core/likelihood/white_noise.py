"""White noise of the raw channels, from second differences of successive strains.

It needs no map, and so it can be measured in the sweep at hand and compared with that of the scan. What makes
a sweep noisier may be common to its channels, as a force that trembles is.
"""

import math
from typing import NamedTuple

import numpy as np

from tactile_localizer.core import compiled
from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene

_LAGS = 1, 2, 4, 8
"""Strains between those of a second difference at which the scan is measured: the farther apart they are, the
more of the signal is in it."""
_BOUND, _MEAN, _ERROR = 4.0, 0.9205, 1.5
"""Bound of a squared difference in variances; of a normal distribution, the mean of bounded ones, and the
standard error of the mean of n, times sqrt(n): successive ones share strains."""
_MEMORY = 50
"""Most strains over which the noise of a sweep is averaged. By judgement."""
_SIGNIFICANT = 2.0
"""Standard errors by which the noise of a sweep has to exceed the scan's. By judgement."""
_SPIKE = 10.0
"""Standard deviations of a second difference from which a strain is a spike. By judgement."""
_GAP = 4.0
"""Ratio of the travel between two strains to the usual one from which it is a gap. By judgement."""
_MOST = 20_000
"""Differences from which the noise of a scan is measured."""


class WhiteNoise(NamedTuple):
    """Variance of second differences of a scan's strains, in units of the variance of one strain.

    Parameters
    ----------
    spacing : (L,) m between successive strains, ascending
    variance : (L, C) V^2
    """

    spacing: np.ndarray
    variance: np.ndarray

    def at(self, spacing: float) -> np.ndarray:
        """Variance (C,) at strains so far apart."""
        upper = min(max(int(self.spacing.searchsorted(spacing)), 1), len(self.spacing) - 1)
        lower = max(upper - 1, 0)
        near, far = float(self.spacing[lower]), float(self.spacing[upper])
        ratio = min(max((spacing - near) / max(far - near, 1e-12), 0.0), 1.0)
        return np.asarray(self.variance[lower] * (1.0 - ratio) + self.variance[upper] * ratio)


def white_noise(scan: Scan, scene: Scene) -> WhiteNoise:
    """White noise of a scan."""
    positions, strain = scan.positions_on(scene) * levers(scene), scan.strain_on(scene)
    rows = np.argsort(scan.sweep, kind="stable")
    spacing, variance = [], []
    for lag in _LAGS:
        first, middle, last = rows[: -2 * lag], rows[lag:-lag], rows[2 * lag :]
        whole = scan.sweep[first] == scan.sweep[last]
        keep = np.flatnonzero(whole)[:: max(1, int(whole.sum()) // _MOST)]
        first, middle, last = first[keep], middle[keep], last[keep]
        if not len(keep):
            continue
        spacing.append(float(np.median(np.linalg.norm(positions[last] - positions[first], axis=1))) / 2.0)
        variance.append(_robust(np.square(strain[first] - 2.0 * strain[middle] + strain[last]) / 6.0))
    if not spacing:
        return WhiteNoise(np.array([0.0, 1.0]), np.zeros((2, strain.shape[1])))
    order = np.argsort(spacing, kind="stable")
    return WhiteNoise(np.array(spacing)[order], np.maximum.accumulate(np.array(variance)[order], axis=0))


def _robust(squares: np.ndarray) -> np.ndarray:
    """Variance (C,) under which bounded squares (n, C) have the mean of a normal distribution's."""
    variance = squares.mean(axis=0) + 1e-300
    for _ in range(50):
        variance *= np.minimum(squares / variance, _BOUND).mean(axis=0) / _MEAN
        variance += 1e-300  # of a channel that does not change
    return np.asarray(variance)


class SweepNoise:
    """White noise of the sweep at hand, as far as it exceeds that of the scan.

    Parameters
    ----------
    of_scan : noise of the scan

    Attributes
    ----------
    spikes : (C,) int, number of spikes of each channel in all sweeps
    is_after_gap : whether the last strain came after a gap, as of a bus or of a hand that was lifted
    """

    def __init__(self, of_scan: WhiteNoise) -> None:
        self._of_scan = of_scan
        self.spikes = np.zeros(of_scan.variance.shape[1], dtype=int)
        self.reset()

    def reset(self) -> None:
        """Begin a sweep: its noise is that of the scan."""
        self._variance = self._of_scan.variance[0] + 1e-300
        self._spacing = float(self._of_scan.spacing[0])
        self._travel, self.is_after_gap = 0.0, False
        self._present, self._strains = b"", 0
        self._may_share, self._products = False, np.eye(len(self._variance))
        self._begin()

    def _begin(self) -> None:
        """Forget the strains before the next one: they do not predict it."""
        self._kept: np.ndarray | None = None
        self._step: np.ndarray | None = None
        self._off = self._replaced = np.zeros(len(self._variance), dtype=bool)
        self._jumped = False

    def observe(self, strain: np.ndarray, present: np.ndarray, travel: float) -> np.ndarray:
        """Take in a strain (C,), V, ``travel`` metres after the last one; ``present`` (C,) bool.

        Returns the strain, in which spikes are replaced by what the two strains before them predict. A spike
        is a single value that is off by :data:`_SPIKE` standard deviations; the next one is taken as it is.
        After a gap, and with other channels, the strains before predict nothing.
        """
        # Until there are two steps the usual one is not known: a sweep may be faster than the scan.
        self.is_after_gap = self._strains > 1 and travel > _GAP * max(self._spacing, self._travel)
        self._travel = travel
        if self.is_after_gap or self._present != present.tobytes():  # compared faster than arrays
            self._present = present.tobytes()
            self._begin()
        self._strains += 1
        if self._kept is None:
            self._kept = strain
            return strain
        if compiled.MODULE is not None and self._took_in(strain, present, travel):
            return strain
        # Before the third strain nothing is predicted: either of the two may be the spike.
        is_predicted = self._step is not None
        predicted = self._kept if self._step is None else self._kept + self._step
        difference = strain - predicted
        squares = np.square(difference) / (6.0 * self._variance)
        off = squares > _SPIKE**2
        jumps = bool(np.count_nonzero(off))
        if jumps or self._jumped:
            self.spikes = self.spikes + (self._replaced & ~off)  # the strain has returned: it was one
            self._replaced = off & ~self._off & is_predicted
            strain = np.where(self._replaced, predicted, strain)
            self._off = self._replaced if is_predicted else off
            self._jumped = bool(np.count_nonzero(self._off))
        if is_predicted:
            gain = self._gain
            bounded = np.minimum(squares, _BOUND)
            if self._may_share:
                felt = np.copysign(np.sqrt(bounded), difference) * present
                self._products += gain * (np.outer(felt, felt) - self._products)
            change = (bounded - _MEAN) * gain
            self._variance = self._variance * (1.0 + change * present)
            self._spacing += (travel - self._spacing) * gain
        step = strain - self._kept
        self._kept, self._step = strain, np.where(off, 0.0, step) if jumps else step  # a jump begins anew
        return strain

    def _took_in(self, strain: np.ndarray, present: np.ndarray, travel: float) -> bool:
        """Take in a strain as most are: predicted, no spike, and of no two noisy channels.

        Returns whether it is; otherwise nothing is done.
        """
        if self._step is None or self._jumped or self._may_share:
            return False
        assert compiled.MODULE is not None
        variance, step = np.empty_like(self._variance), np.empty_like(self._variance)
        before, how = (self._kept, self._step, self._variance), (_SPIKE**2, _BOUND, _MEAN, self._gain)
        if compiled.MODULE.noise(strain, present, *before, *how, variance, step):
            return False
        self._variance, self._kept, self._step = variance, strain, step
        self._spacing += (travel - self._spacing) * self._gain
        return True

    def excess(self, pitch: float) -> np.ndarray:
        """Covariance (C, C), V^2, by which the noise of a mean over ``pitch`` metres exceeds the scan's.

        Zero of channels that do so by less than :data:`_SIGNIFICANT` standard errors of the scan's noise.
        """
        usual = self._of_scan.at(self._spacing)
        noisy = self._variance > usual * (1.0 + _SIGNIFICANT * _ERROR * math.sqrt(self._gain))
        count = int(np.count_nonzero(noisy))
        self._may_share = count > 1
        if not count:
            return np.zeros_like(self._products)
        more = np.where(noisy, self._variance - usual, 0.0) / max(pitch / max(self._spacing, 1e-9), 1.0)
        if not self._may_share:
            return np.diag(more)
        width = np.sqrt(more)
        return np.asarray(width[:, None] * self._correlation(noisy) * width)

    def _correlation(self, noisy: np.ndarray) -> np.ndarray:
        """Correlation (C, C) of the channels, of which some are ``noisy`` (C,) bool.

        It is shrunk by what chance adds to that of these (Schäfer and Strimmer, 2005).
        """
        width = np.sqrt(np.maximum(self._products.diagonal(), 1e-300))
        found = self._products / np.outer(width, width)
        np.fill_diagonal(found, 0.0)
        squares, pairs = np.square(found), np.outer(noisy, noisy)
        np.fill_diagonal(pairs, False)
        chance = np.square(1.0 - squares) * (_ERROR**2 * self._gain)
        found *= max(1.0 - float(chance[pairs].sum()) / max(float(squares[pairs].sum()), 1e-300), 0.0)
        np.fill_diagonal(found, 1.0)
        return found

    @property
    def _gain(self) -> float:
        """Weight of a strain in the mean, which is of all at first: noise is known before contact."""
        return 1.0 / min(max(self._strains, 1), _MEMORY)
