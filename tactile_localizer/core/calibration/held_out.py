"""Registration error, from held-out sweeps that are registered to the others.

Fingers flex, material stretches and recordings start late, which shifts sweeps against each other. The shift
of a held-out sweep is tracked by a Kalman filter, linear about the true positions, with the variances and the
exponents that the localizer has, but for the gain of the signal: what a sweep's gain looks like counts as a
shift. The variance of the errors behind these shifts is added to that of the filter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tactile_localizer.core.calibration.sweep_model import SweepModel
from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.likelihood.student_t import weight
from tactile_localizer.core.scan.interpolation import interpolate
from tactile_localizer.core.scan.lines import on_line_of
from tactile_localizer.core.scan.tracks import PITCH, evenly
from tactile_localizer.scene import Scene

_MAX_HELD_OUT_SWEEPS = 24
"""Sweeps that are held out."""
_LONGEST = round(0.2 / PITCH)
"""Points of a sweep that are registered: of a sheet of 2 m one part."""
_PRIOR_STD, _PRIOR_ERRORS = 0.0015, 5.0
"""Prior of the registration error, m, and the number of independent errors it counts as: later sweeps move
more than those of a scan. By judgement."""
_WRONG_PLACE_M = 0.02
"""m: standard deviation of a shift before contact, and the uncertainty from which it is not known."""
_SURROUNDINGS = 0.05
"""m around a scan in which a hand is localized."""
_BEYOND = 0.001
"""m beyond a scan that a hand is still on the map, as its position has errors."""
_ITERATIONS = 50


def registration_errors(model: SweepModel, information_length: float) -> np.ndarray:
    """Standard deviation (d,), m (yaw: rad), of the shifts of sweeps against those of the other lines.

    ``information_length`` is the travel per independent measurement, m.
    """
    scan, tracks = model.scan, model.scan.tracks
    found = []
    for index in evenly(len(tracks), _MAX_HELD_OUT_SWEEPS) if len(tracks) > 1 else []:
        part = _most_signal(tracks.slices[index], scan.signal)
        shift, variance = register(model, part, on_line_of(tracks, index), information_length)
        known = variance.sum(axis=1) < _WRONG_PLACE_M**2  # before contact the position is open
        if known.any():
            found.append((shift[known], variance[known]))
    return registration_std(found, tracks.scene.dimension) / levers(tracks.scene)


def _most_signal(points: slice, signal: np.ndarray) -> slice:
    """The :data:`_LONGEST` points of a track with the most signal (n, C)."""
    count = min(_LONGEST, points.stop - points.start)
    felt = np.convolve(signal[points].any(axis=1), np.ones(count), "valid")
    first = points.start + int(felt.argmax())
    return slice(first, first + count)


def register(
    model: SweepModel, points: slice, without: np.ndarray, information_length: float
) -> tuple[np.ndarray, np.ndarray]:
    """Shifts along ``points`` of a track against the tracks that are not ``without`` (S,) bool.

    They are in m, with their variances in m^2 (yaw by its lever), both (n, d).
    """
    scan, layout, tracks = model.scan, model.scan.noise.layout, model.scan.tracks
    scene, material, scale = tracks.scene, model.scan.material, levers(tracks.scene)
    positions, axes = tracks.positions[points], scene.dimension
    step = max(0.5 * scan.spacing, PITCH)
    beside = step * np.vstack([np.zeros(axes), np.eye(axes), -np.eye(axes)]) / scale
    places = (positions + beside[:, None]).reshape(-1, axes)
    interpolation = interpolate(tracks, places, scan.spacing, without)
    expected = interpolation.expected(scan.signal)
    spread = model.variance.variance(expected, layout)[: len(positions), 0]
    mean = expected.average.reshape(len(beside), len(positions), -1)
    residual, slope = scan.strain[points] - mean[0], (mean[1 : 1 + axes] - mean[1 + axes :]) / (2.0 * step)
    residual = material.innovations(residual, tracks.pitch, robust=True)
    slope = np.stack([material.innovations(each, tracks.pitch) for each in slope])
    travel = np.linalg.norm(np.diff(positions * scale, axis=0, prepend=positions[:1] * scale), axis=1)
    exponent = min(1.0, tracks.pitch / information_length)
    drift = np.diag(np.square(scene.motion_std * scale))
    # A line may be mistaken for another one, but not for one that was not scanned.
    widths = np.minimum(_WRONG_PLACE_M, np.ptp(tracks.positions, axis=0) * scale / math.sqrt(12.0))
    shift, covariance, found = np.zeros(axes), np.diag(np.square(np.maximum(widths, step))), []
    for left, gradient, variance, moved in zip(residual, slope.swapaxes(0, 1), spread, travel, strict=True):
        covariance = covariance + moved * drift
        innovation = left - shift @ gradient
        predicted = variance + layout.mean(np.einsum("ic,ij,jc->c", gradient, covariance, gradient))
        squared = layout.sum(innovation**2) / predicted
        precision = weight(squared, layout.widths) / variance
        weighted = exponent * layout.expand(precision) * gradient
        covariance = np.linalg.inv(np.linalg.inv(covariance) + weighted @ gradient.T)
        shift = shift + covariance @ weighted @ innovation
        found.append((shift, covariance.diagonal()))
    return np.array([each for each, _ in found]), np.array([each for _, each in found])


def surroundings(scene: Scene, positions: np.ndarray) -> Scene:
    """The scene in which a hand is localized that was scanned at ``positions`` (n, d).

    Its bounds are those given, but at least :data:`_BEYOND` and at most :data:`_SURROUNDINGS` around the
    positions within them. Those of yaw are not widened, and full-turn axes remain whole.
    """
    scale, axes = levers(scene), []
    for axis, wraps, lever, along in zip(scene.axes, scene.wraps, scale, positions.T, strict=True):
        if not wraps:
            inside, most = along.clip(axis.lower, axis.upper), _SURROUNDINGS / lever
            first, last = float(inside.min()), float(inside.max())
            least = -math.inf if axis.name == "yaw" else _BEYOND
            lower = max(min(axis.lower, first - least), first - most)
            upper = min(max(axis.upper, last + least), last + most)
            axis = replace(axis, lower=lower, upper=upper)
        axes.append(axis)
    return replace(scene, axes=tuple(axes))


def registration_std(found: Sequence[tuple[np.ndarray, np.ndarray]], axes: int) -> np.ndarray:
    """Standard deviation (d,), m, of the registration error on d ``axes``, from the shifts (n, d) of sweeps.

    EM over the errors (Laird and Ware, 1982), which have t-distributions: some sweeps are mistaken for
    another place. A sweep counts as one error, whatever its length.
    """
    if not found:
        return np.full(axes, _PRIOR_STD)
    shift, variance = (np.concatenate(each) for each in zip(*found, strict=True))
    weights = np.concatenate([np.full((len(each), 1), 1.0 / len(each)) for each, _ in found])
    count, error = _PRIOR_ERRORS + len(found), np.full(axes, _PRIOR_STD**2)
    for _ in range(_ITERATIONS):
        total = error + variance
        tails = weight(shift**2 / total, 1.0)
        squares = weights * (tails * (error / total * shift) ** 2 + error * variance / total)
        error = (_PRIOR_ERRORS * _PRIOR_STD**2 + squares.sum(axis=0)) / count
    return np.asarray(np.sqrt(error))
