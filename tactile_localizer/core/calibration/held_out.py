"""Tempering and registration, from sweeps that are held out of the map and localized on it.

*Tempering*: the map's own errors recur from strain to strain, so consecutive strains are no independent
measurements. The travel that makes one is the longest whose error on held-out sweeps is within one standard
error of the least.

*Registration*: fingers flex, material stretches and recordings begin late. Where one sweep felt a place,
another feels it a little further on. Its variance is added to the filter's, so that the predictive density of
held-out positions is largest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.calibration.sweep_model import SweepModel
from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.likelihood.strain_map import VarianceModel
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.scan.tracks import PITCH, Track, evenly
from tactile_localizer.scene import Scene

INFORMATION_LENGTHS = (0.001, 0.0017, 0.003, 0.005)
"""m of travel between two independent measurements: the candidates."""
_MOST_SWEEPS = 10
"""Sweeps that are held out, one after another: each takes a new map."""
_PRIOR_STD = PITCH
_PRIOR_ERRORS = 5.0
"""Registration of a scan of which nothing is known, m, and how many independent errors it counts for. By
judgement; repeats of the same slide over two fabrics are shifted by 0.1 to 0.5 mm. On four fabrics the least
coverage of the 95 % region was .88, .89 and .87 with 2, 5 and 10 errors."""
_MISTAKE = 0.02
"""Error, m, beyond which a sweep was mistaken for another place: how far does not matter."""
_SURROUNDINGS = 0.05
"""m around a sweep within which it is localized: more than twice what counts as mistaken. The rest of a large
scan would take minutes."""
_BOUND = 6.0
"""Medians of an error's size beyond which it was mistaken for another place."""
_ONE_SIGMA = 0.8413
_CANDIDATES = np.geomspace(0.25, 12.0, 32)
"""Registrations that are tried, in units of the prior's."""
_LINES_PER_CELL = 1.0 / 3.0


class Calibration(NamedTuple):
    """What held-out sweeps say about the filter.

    Parameters
    ----------
    information_length : m of travel that make one independent measurement of the position
    registration_std : (d,) m (yaw: rad), how far the positions of one sweep are from those of another
    variance : of the visits that the sweeps were localized with; ``None``: not kept
    """

    information_length: float
    registration_std: np.ndarray
    variance: VarianceModel | None = None


class _Outcome(NamedTuple):
    """Errors, m, and variances, m^2 (yaw by its lever), both (n, d), along one held-out sweep.

    ``felt`` (n,) bool is where the material has a signal.
    """

    errors: np.ndarray
    variance: np.ndarray
    felt: np.ndarray

    @property
    def error(self) -> float:
        """Mean error, m; one that is as large as a mistake counts no more than that."""
        return float(np.minimum(np.linalg.norm(self.errors, axis=1), _MISTAKE).mean())


def calibrate(
    scene: Scene, model: SweepModel, localizer: Callable[[Scene, SweepMixture], Localizer]
) -> Calibration:
    """Localize sweeps on the map of the others, of a large scan on the surroundings of each sweep.

    Parameters
    ----------
    model : learned from the scan
    localizer : makes one of a scene and a mixture, without registration
    """
    # Two slides over cloth do not tell the candidates apart, and with the shortest other fabrics converge.
    lengths = INFORMATION_LENGTHS if model.noise.featureless else INFORMATION_LENGTHS[-1:]
    sweeps = len(model.noise.tracks)
    if sweeps < 2:
        return Calibration(lengths[-1], np.full(scene.dimension, _PRIOR_STD) / levers(scene), model.variance)
    chosen = evenly(sweeps, _MOST_SWEEPS)

    def localize(index: int, without: tuple[int, ...], lengths: Sequence[float]) -> list[_Outcome]:
        track, felt = model.noise.recorded[index], np.any(model.noise.tracks[index].strain, axis=1)
        near = surroundings(scene, track.positions)
        mixture = model.mixture(near, _LINES_PER_CELL, lengths[0], without)
        return [_localize(localizer(near, mixture.tempered(each)), track, felt, near) for each in lengths]

    errors = [[outcome.error for outcome in localize(i, (i,), lengths)] for i in chosen]
    length = lengths[_longest(np.array(errors))]
    # Without a neighbour where there are enough: it is alike beyond chance, in the same deformation mode.
    outcomes = [
        localize(i, (i, i + 1) if sweeps > 3 and i + 1 < sweeps else (i,), (length,))[0] for i in chosen
    ]
    # A sweep against the mean of all of them, from sweeps against the mean of the others.
    scale = np.sqrt((1.0 + 1.0 / sweeps) / (1.0 + 1.0 / (sweeps - 1)))
    return Calibration(length, scale * _registration(outcomes, scene), model.variance)


def surroundings(scene: Scene, positions: np.ndarray) -> Scene:
    """The scene as far as :data:`_SURROUNDINGS` around positions (n, d); axes that wrap remain whole."""
    low = positions.min(axis=0) - _SURROUNDINGS / levers(scene)
    high = positions.max(axis=0) + _SURROUNDINGS / levers(scene)
    axes = tuple(
        axis
        if wraps
        else replace(axis, lower=float(max(axis.lower, least)), upper=float(min(axis.upper, most)))
        for axis, wraps, least, most in zip(scene.axes, scene.wraps, low, high, strict=True)
    )
    return replace(scene, axes=axes)


def _longest(errors: np.ndarray) -> int:
    """The last candidate whose mean of the errors (S, L) is within one standard error of the least."""
    from scipy.special import stdtrit  # takes a third of a second to import, which a calibrated scan saves

    best = int(errors.mean(axis=0).argmin())
    loss = errors - errors[:, best : best + 1]
    # Of two sweeps the standard error is hardly known: Student's t is as wide as that deserves.
    tolerance = stdtrit(len(errors) - 1, _ONE_SIGMA) * loss.std(axis=0, ddof=1) / np.sqrt(len(errors))
    return int(np.flatnonzero(loss.mean(axis=0) <= tolerance)[-1])


def _localize(localizer: Localizer, track: Track, felt: np.ndarray, scene: Scene) -> _Outcome:
    """Errors of a localizer along a sweep, from a uniform prior."""
    localizer.reset()
    errors, variance, rows = [], [], []
    for index, (position, strain) in enumerate(zip(track.positions, track.strain, strict=True)):
        estimate = localizer.update(10_000_000 * index, position, strain)
        if estimate.updated:
            error = estimate.mean - position
            errors.append(np.where(scene.wraps, wrap_angle(error), error))
            variance.append(np.diag(estimate.covariance))
            rows.append(index)
    return _Outcome(np.array(errors) * levers(scene), np.array(variance) * levers(scene) ** 2, felt[rows])


def _registration(outcomes: Sequence[_Outcome], scene: Scene) -> np.ndarray:
    """Standard deviation (d,), from the independent errors of each sweep beside those of the prior.

    Before contact the position is open, which says nothing about registration. Of equals the largest: less
    than half a nat below the most probable, which is one standard error.
    """
    found = []
    known = [each.felt & (each.variance.sum(axis=1) < _MISTAKE**2) for each in outcomes]
    felt = [(each.errors[rows], each.variance[rows]) for each, rows in zip(outcomes, known, strict=True)]
    # Each sweep is held out of the others' mean, in which it was one: together they lack one.
    share = 1.0 - 1.0 / max(len(outcomes), 2)
    extent = (scene.upper - scene.lower) * levers(scene)
    for axis in range(scene.dimension):
        candidates = _PRIOR_STD * _CANDIDATES
        fit = -0.5 * _PRIOR_ERRORS * (2.0 * np.log(candidates) + (_PRIOR_STD / candidates) ** 2)
        for errors, variance in (each for each in felt if len(each[0])):
            count = share * _independent(errors[:, axis])
            fit += [
                count * _log_density(errors[:, axis] ** 2, variance[:, axis] + each**2, extent[axis])
                for each in candidates
            ]
        found.append(candidates[np.flatnonzero(fit > fit.max() - 0.5)[-1]])
    return np.array(found) / levers(scene)


def _independent(errors: np.ndarray) -> float:
    """Effective number of independent samples in ``errors`` (n,), which are in order along a sweep.

    n over the integrated autocorrelation, up to its first zero; a constant error counts as one sample.
    """
    bound = _BOUND * np.median(np.abs(errors))
    bounded = errors.clip(-bound, bound)
    n = len(bounded)
    correlation = np.correlate(bounded, bounded, "full")[n - 1 :]
    if correlation[0] <= 0.0:
        return 1.0
    vanished = np.flatnonzero(correlation <= 0.0)
    end = int(vanished[0]) if len(vanished) else n
    return float(n * correlation[0] / (2.0 * correlation[:end].sum() - correlation[0]))


def _log_density(squared: np.ndarray, variance: np.ndarray, extent: float) -> float:
    """Mean logarithm of a normal density, with a hundredth uniform for mistaken places."""
    normal = -0.5 * (squared / variance + np.log(2.0 * np.pi * variance))
    return float(np.logaddexp(normal + math.log(0.99), math.log(0.01 / extent)).mean())
