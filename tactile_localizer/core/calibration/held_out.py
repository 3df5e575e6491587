"""Tempering and registration, from sweeps that are held out of the map and localized on it.

*Tempering*: the map's own errors recur from strain to strain, so consecutive strains are no independent
measurements. The travel that makes one is chosen by the predictive density of the held-out positions.

*Registration*: fingers flex, material stretches and recordings begin late. Where one sweep felt a place,
another feels it a little further on. What the squared errors of held-out sweeps exceed the filter's variance
by is the variance of the registration.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.calibration.sweep_model import SweepModel
from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.scan.tracks import lever
from tactile_localizer.scene import Scene

INFORMATION_LENGTHS = (0.001, 0.0015, 0.0022, 0.0033, 0.005)
"""m of travel between two independent measurements: the candidates."""
_MOST_SWEEPS = 6
"""Sweeps that are held out, one after another: each takes a new map."""
_PRIOR_STD = 0.0004
_PRIOR_SWEEPS = 2.0
"""Registration of a scan of which nothing is known, m, and how many held-out sweeps it counts for. By
judgement; repeats of the same slide over two fabrics are shifted by 0.1 to 0.5 mm."""
_CANDIDATES = np.geomspace(0.25, 12.0, 32)
"""Registrations that are tried, in units of the prior's."""
_LINES_PER_CELL = 1.0 / 3.0


class Calibration(NamedTuple):
    """What held-out sweeps say about the filter.

    Parameters
    ----------
    information_length : m of travel that make one independent measurement of the position
    registration_std : (d,) m (yaw: rad), how far the positions of one sweep are from those of another
    """

    information_length: float
    registration_std: np.ndarray


class _Outcome(NamedTuple):
    """Squared errors and variances (n, d), m, of the estimates along one held-out sweep."""

    squared: np.ndarray
    variance: np.ndarray


def calibrate(scene: Scene, model: SweepModel, localizer: Callable[[SweepMixture], Localizer]) -> Calibration:
    """Localize sweeps on the map of the others, without a neighbour where there are enough.

    Neighbours are alike beyond chance, because the material was in the same deformation mode.

    Parameters
    ----------
    model : learned from the scan
    localizer : makes one of a mixture, without registration
    """
    lengths = INFORMATION_LENGTHS
    sweeps = len(model.noise.tracks)
    outcomes: list[list[_Outcome]] = [[] for _ in lengths]
    for index, without in _held_out(sweeps):
        track = model.noise.recorded[index]
        mixture = model.mixture(scene, _LINES_PER_CELL, lengths[0], without)
        for own, length in zip(outcomes, lengths, strict=True):
            one = localizer(mixture.tempered(length))
            own.append(_localize(one, track.positions, track.strain, scene))
    if not outcomes[0]:
        return Calibration(lengths[-1], np.full(scene.dimension, _PRIOR_STD) / lever(scene))
    registrations = [_registration(own, scene) for own in outcomes]
    scores = np.array(
        [
            [_score(outcome, registration, scene).mean() for outcome in own]
            for own, registration in zip(outcomes, registrations, strict=True)
        ]
    )
    chosen = _most_cautious(scores)
    # A sweep against the mean of all of them, from sweeps against the mean of the others.
    scale = np.sqrt((1.0 + 1.0 / sweeps) / (1.0 + 1.0 / (sweeps - 1)))
    return Calibration(lengths[chosen], scale * registrations[chosen])


def _held_out(count: int) -> list[tuple[int, tuple[int, ...]]]:
    """Numbers of sweeps to localize, each with those to leave out of its map."""
    if count < 2:
        return []
    if count <= _MOST_SWEEPS:
        chosen = np.arange(count)
    else:
        chosen = np.linspace(0, count - 1, _MOST_SWEEPS + 2)[1:-1].round().astype(int)
    return [(int(i), (int(i), int(i) + 1) if count > 3 and i + 1 < count else (int(i),)) for i in chosen]


def _localize(localizer: Localizer, positions: np.ndarray, strain: np.ndarray, scene: Scene) -> _Outcome:
    """Errors of a localizer along a sweep, from a uniform prior."""
    localizer.reset()
    squared, variance = [], []
    for index, (position, each) in enumerate(zip(positions, strain, strict=True)):
        estimate = localizer.update(10_000_000 * index, position, each)
        if estimate.updated:
            error = estimate.mean - position
            squared.append(np.where(scene.wraps, wrap_angle(error), error) ** 2)
            variance.append(np.diag(estimate.covariance))
    return _Outcome(np.array(squared), np.array(variance))


def _registration(outcomes: Sequence[_Outcome], scene: Scene) -> np.ndarray:
    """Most probable standard deviation (d,): one observation per sweep, beside those of the prior."""
    found = []
    for axis, unit in enumerate(lever(scene)):
        prior = _PRIOR_STD / unit
        candidates = prior * _CANDIDATES
        fit = -0.5 * _PRIOR_SWEEPS * (2.0 * np.log(candidates) + (prior / candidates) ** 2)
        for outcome in outcomes:
            fit += [_axis_score(outcome, axis, each, scene).mean() for each in candidates]
        found.append(candidates[fit.argmax()])
    return np.array(found)


def _score(outcome: _Outcome, registration: np.ndarray, scene: Scene) -> np.ndarray:
    """Logarithm (n,) of the predictive density of the position along a sweep."""
    return np.sum([_axis_score(outcome, a, std, scene) for a, std in enumerate(registration)], axis=0)


def _axis_score(outcome: _Outcome, axis: int, registration: float, scene: Scene) -> np.ndarray:
    """The same on one axis: normal, with a hundredth uniform for what was mistaken for another place."""
    variance = outcome.variance[:, axis] + registration**2
    normal = -0.5 * (outcome.squared[:, axis] / variance + np.log(2.0 * np.pi * variance))
    uniform = -math.log(scene.upper[axis] - scene.lower[axis])
    return np.logaddexp(normal + math.log(0.99), uniform + math.log(0.01))


def _most_cautious(scores: np.ndarray) -> int:
    """The last of the candidates (L, S) within one standard error of the best mean over sweeps."""
    best = int(scores.mean(axis=1).argmax())
    loss = scores[best] - scores
    error = (
        loss.std(axis=1, ddof=1) / np.sqrt(scores.shape[1]) if scores.shape[1] > 1 else np.zeros(len(scores))
    )
    return int(np.flatnonzero(loss.mean(axis=1) <= error)[-1])
