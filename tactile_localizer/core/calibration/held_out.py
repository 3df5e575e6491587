"""Registration error, from held-out sweeps that are localized on the map of the others.

Fingers flex, material stretches and recordings start late, which shifts sweeps against each other. The
variance added to that of the filter maximizes the predictive density of held-out positions.
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
from tactile_localizer.core.scan.lines import neighbours
from tactile_localizer.core.scan.tracks import PITCH, Track, evenly
from tactile_localizer.scene import Scene

_MAX_HELD_OUT_SWEEPS = 24
"""Sweeps that are held out, each of which takes one or two new maps."""
_LONGEST = round(0.2 / PITCH)
"""Points of a sweep that are localized: of a sheet of 2 m one part, on a map of that part."""
_PRIOR_STD = PITCH
_PRIOR_ERRORS = 5.0
"""Prior of the registration error, m, and the number of independent errors it counts as. By judgement."""
_WRONG_PLACE_M = 0.02
"""Error, m, from which a place was mistaken for another one, and the size of the error is irrelevant."""
_SURROUNDINGS = 0.05
"""m around a sweep within which it is localized, more than twice a mistake; a large map is slow."""
_MAX_RELATIVE_ERROR = 6.0
"""Multiple of the median absolute error at which errors are clipped."""
_MAX_DROP_NATS = 1.0
"""nats below the most probable at which a candidate is rejected: 1.4 standard errors. By judgement."""
_CANDIDATES = np.geomspace(0.25, 12.0, 32)
"""Candidates for the registration error, in units of the prior."""
_LINES_PER_CELL = 1.0 / 3.0


class Calibration(NamedTuple):
    """Parameters of the filter learned from held-out sweeps.

    Parameters
    ----------
    information_length : m of travel per independent measurement of the position
    registration_std : (d,) m (yaw: rad), standard deviation of the shift between sweeps
    variance : variance model under which the sweeps were localized; ``None``: not stored
    """

    information_length: float
    registration_std: np.ndarray
    variance: VarianceModel | None = None


class _Outcome(NamedTuple):
    """Errors, m, and variances, m^2 (yaw by its lever), both (n, d), along one held-out sweep.

    ``has_signal`` (n,) bool is false on featureless material.
    """

    errors: np.ndarray
    variance: np.ndarray
    has_signal: np.ndarray


def calibrate(
    scene: Scene, model: SweepModel, localizer: Callable[[Scene, np.ndarray, SweepMixture], Localizer]
) -> Calibration:
    """Localize sweeps on the map of the others, within the surroundings of each sweep.

    Parameters
    ----------
    model : sweep model of the scan
    localizer : makes one from a scene, the size of its cells and a mixture, without registration error
    """
    sweeps = len(model.noise.tracks)
    if sweeps < 2:
        return Calibration(
            model.information_length, np.full(scene.dimension, _PRIOR_STD) / levers(scene), model.variance
        )

    def localize(index: int, without: np.ndarray) -> _Outcome:
        has_signal = np.any(model.noise.tracks[index].strain, axis=1)
        part = _most_signal(has_signal)
        track, has_signal = Track(*(each[part] for each in model.noise.recorded[index])), has_signal[part]
        near = surroundings(scene, track.positions)
        rows = tuple(np.flatnonzero(without).tolist())
        cell = model.cell(near, _LINES_PER_CELL)
        return _localize(localizer(near, cell, model.mixture(near, cell, rows)), track, has_signal, near)

    def outcome(index: int) -> _Outcome:
        own, beside = neighbours(model.noise.tracks, scene, index)
        if sweeps - (own | beside).sum() < 2:
            return localize(index, own)
        along = localize(index, own | beside)
        if scene.dimension == 1:
            return along
        return _composed(along, localize(index, own), model.noise.recorded[index], scene)

    outcomes = [outcome(index) for index in evenly(sweeps, _MAX_HELD_OUT_SWEEPS)]
    # From the error of a sweep against the mean of the others to that of a new sweep against the mean of all.
    scale = np.sqrt((1.0 + 1.0 / sweeps) / (1.0 + 1.0 / (sweeps - 1)))
    registration = scale * _registration(outcomes, scene)
    return Calibration(model.information_length, registration, model.variance)


def _most_signal(has_signal: np.ndarray) -> slice:
    """The :data:`_LONGEST` points of a track (n,) bool with the most signal."""
    count = min(_LONGEST, len(has_signal))
    first = int(np.convolve(has_signal, np.ones(count), "valid").argmax())
    return slice(first, first + count)


def surroundings(scene: Scene, positions: np.ndarray) -> Scene:
    """The scene cropped to :data:`_SURROUNDINGS` around positions (n, d); full-turn axes remain whole."""
    low = positions.min(axis=0) - _SURROUNDINGS / levers(scene)
    high = positions.max(axis=0) + _SURROUNDINGS / levers(scene)
    axes = tuple(
        axis
        if wraps
        else replace(axis, lower=float(max(axis.lower, least)), upper=float(min(axis.upper, most)))
        for axis, wraps, least, most in zip(scene.axes, scene.wraps, low, high, strict=True)
    )
    return replace(scene, axes=axes)


def _localize(localizer: Localizer, track: Track, has_signal: np.ndarray, scene: Scene) -> _Outcome:
    """Localize a sweep from a uniform prior."""
    localizer.reset()
    errors, variance, rows = [], [], []
    for index, (position, strain) in enumerate(zip(track.positions, track.strain, strict=True)):
        estimate = localizer.update(10_000_000 * index, position, strain)
        if estimate.updated:
            error = estimate.mean - position
            errors.append(np.where(scene.wraps, wrap_angle(error), error))
            variance.append(np.diag(estimate.covariance))
            rows.append(index)
    scale = levers(scene)
    return _Outcome(np.array(errors) * scale, np.array(variance) * scale**2, has_signal[rows])


def _composed(along: _Outcome, across: _Outcome, track: Track, scene: Scene) -> _Outcome:
    """Errors along a sweep without the nearest line, and across it with that line.

    Along it the nearest line resembles the sweep by chance, in the same deformation mode, which a new sweep
    does not. Across it the gap without that line makes errors that a new sweep does not have.
    """
    direction = (track.positions[-1] - track.positions[0]) * levers(scene)
    fraction = direction**2 / max(float(direction @ direction), np.finfo(np.float64).tiny)
    errors = fraction * along.errors + (1.0 - fraction) * across.errors
    variance = fraction * along.variance + (1.0 - fraction) * across.variance
    return _Outcome(errors, variance, along.has_signal)


def _registration(outcomes: Sequence[_Outcome], scene: Scene) -> np.ndarray:
    """Standard deviation (d,) of the registration error, from the errors of each sweep and the prior.

    Errors before contact, where the position is open, are excluded. Of the candidates
    that the errors do not reject the largest is returned: test sweeps move more than those of a scan.
    """
    found = []
    known = [each.has_signal & (each.variance.sum(axis=1) < _WRONG_PLACE_M**2) for each in outcomes]
    parts = [(each.errors[rows], each.variance[rows]) for each, rows in zip(outcomes, known, strict=True)]
    # The errors of n sweeps, each against the mean of the others, have n - 1 degrees of freedom.
    freedom = 1.0 - 1.0 / max(len(outcomes), 2)
    extent = scene.extent * levers(scene)
    for axis in range(scene.dimension):
        candidates = _PRIOR_STD * _CANDIDATES
        fit = -0.5 * _PRIOR_ERRORS * (2.0 * np.log(candidates) + (_PRIOR_STD / candidates) ** 2)
        for errors, variance in (part for part in parts if len(part[0])):
            count = freedom * independent_samples(errors[:, axis])
            fit += [
                count * _log_density(errors[:, axis] ** 2, variance[:, axis] + each**2, extent[axis])
                for each in candidates
            ]
        found.append(candidates[np.flatnonzero(fit > fit.max() - _MAX_DROP_NATS)[-1]])
    return np.array(found) / levers(scene)


def independent_samples(errors: np.ndarray) -> float:
    """Effective number of independent samples in a series of errors (n,).

    It is n over the autocorrelation integrated up to its first zero; a constant error counts as one sample.
    """
    bound = _MAX_RELATIVE_ERROR * np.median(np.abs(errors))
    bounded = errors.clip(-bound, bound)
    n = len(bounded)
    correlation = np.correlate(bounded, bounded, "full")[n - 1 :]
    if correlation[0] <= 0.0:
        return 1.0
    vanished = np.flatnonzero(correlation <= 0.0)
    end = int(vanished[0]) if len(vanished) else n
    return float(n * correlation[0] / (2.0 * correlation[:end].sum() - correlation[0]))


def _log_density(squared: np.ndarray, variance: np.ndarray, extent: float) -> float:
    """Mean log-density of squared errors, normal with a uniform fraction of 1 % for mistaken places."""
    normal = -0.5 * (squared / variance + np.log(2.0 * np.pi * variance))
    return float(np.logaddexp(normal + math.log(0.99), math.log(0.01 / extent)).mean())
