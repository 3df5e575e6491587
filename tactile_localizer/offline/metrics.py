"""Metrics of a replay: error, consistency of the covariance, convergence, computing time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.likelihood.strain_map import StrainMap
from tactile_localizer.io.recording import Recording
from tactile_localizer.offline.replay import Track
from tactile_localizer.scene import Scene

INCH = 0.0254
"""One inch, m."""

MARKS = (0.0025, 0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64)
"""Travel after which the error is reported, m."""

SQUARED_95 = {1: 3.841458820694124, 2: 5.991464547107979, 3: 7.814727903251179}
"""95 % quantiles of the chi-square distribution, by number of axes."""

_ROUNDING = 1e-9
"""Rounding error of a sum of many steps, m."""

_MIN_VARIANCE = 1e-18
"""Lower bound of the variance, m² (yaw: rad²): the covariance of identical particles is zero."""


def deviation(scene: Scene, mean: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Estimate minus truth (n, d); on axes that wrap, along the shortest arc."""
    difference = mean - truth
    difference[:, scene.wraps] = wrap_angle(difference[:, scene.wraps])
    return difference


def position_error(scene: Scene, track: Track) -> np.ndarray:
    """Distance between estimate and truth without the yaw, (n,) m; NaN where unknown."""
    lengths = np.array([axis.name != "yaw" for axis in scene.axes])
    if track.truth is None or not lengths.any():
        return np.full(len(track), np.nan)
    return np.linalg.norm(deviation(scene, track.mean, track.truth)[:, lengths], axis=1)


def yaw_error(scene: Scene, track: Track) -> np.ndarray:
    """Absolute error of the yaw, (n,) rad; NaN where there is no yaw or no truth."""
    if track.truth is None or "yaw" not in scene.axis_names:
        return np.full(len(track), np.nan)
    return np.abs(deviation(scene, track.mean, track.truth)[:, scene.axis_names.index("yaw")])


def squared_mahalanobis(scene: Scene, track: Track) -> np.ndarray:
    """Squared Mahalanobis distance between estimate and truth, (n,); d on average if consistent."""
    if track.truth is None:
        return np.full(len(track), np.nan)
    difference = deviation(scene, track.mean, track.truth)
    values, vectors = np.linalg.eigh(track.covariance)
    along = np.einsum("ndk,nd->nk", vectors, difference)
    return np.sum(along**2 / np.maximum(values, _MIN_VARIANCE), axis=1)


def calibration(scene: Scene, tracks: Sequence[Track]) -> dict[str, Any]:
    """Normalized estimation error squared (NEES) per degree of freedom, and coverage of the 95 % region."""
    squared = _pooled([squared_mahalanobis(scene, track) for track in tracks])
    if not len(squared):
        return {"nees": None, "coverage_95": None}
    return {
        "nees": float(np.mean(squared) / scene.dimension),
        "coverage_95": float(np.mean(squared <= SQUARED_95[scene.dimension])),
    }


def statistics(values: np.ndarray) -> dict[str, Any]:
    """Count, median, mean, 95th percentile and maximum of the finite values; ``None`` if there are none."""
    values = values[np.isfinite(values)]
    if not len(values):
        return {"count": 0, "median": None, "mean": None, "p95": None, "max": None}
    return {
        "count": len(values),
        "median": float(np.median(values)),
        "mean": float(np.mean(values)),
        "p95": float(np.quantile(values, 0.95)),
        "max": float(np.max(values)),
    }


def error_at(errors: Sequence[np.ndarray], tracks: Sequence[Track], mark: float) -> np.ndarray:
    """Errors of the tracks that are long enough after ``mark`` m of :func:`travel_from_contact`."""
    found = []
    for error, track in zip(errors, tracks, strict=True):
        travel = travel_from_contact(track)
        if len(track) and travel[-1] >= mark - _ROUNDING:
            found.append(error[np.searchsorted(travel, mark - _ROUNDING)])
    return np.array(found)


def travel_from_contact(track: Track) -> np.ndarray:
    """Travel from contact, (n,) m, negative before it; from the start of a sweep without contact."""
    return track.travel - track.travel[track.start] if len(track) else track.travel


def travel_to_convergence(tracks: Sequence[Track]) -> np.ndarray:
    """:func:`travel_from_contact` of each track's first converged entry; NaN where it never converged."""
    return np.array(
        [
            travel_from_contact(track)[np.argmax(track.converged)] if track.converged.any() else np.nan
            for track in tracks
        ]
    )


def with_contact(recording: Recording, scene: Scene, strain_map: StrainMap) -> Recording:
    """Mark the samples in contact with a feature, in sweeps whose true positions are known.

    A recorded mark is kept; the simulator writes one. Otherwise a sample is in contact if the map predicts
    more than the noise of one sweep for a phalanx at the true position. Material that is textured everywhere
    has no contact.

    Parameters
    ----------
    recording : recording with the axes and phalanges of ``scene``
    strain_map : map of the localizer
    """
    if strain_map.featureless_variance is None:
        return recording
    expected = np.einsum("mk,mkc->mc", np.exp(strain_map.log_prior), strain_map.mean)
    energy = scene.layout.sum(expected**2) / np.array(scene.layout.counts)
    in_contact = (energy > 1.0).any(axis=1)
    sweeps = []
    for sweep in recording.sweeps:
        if sweep.felt is None and sweep.truth is not None and np.isfinite(sweep.truth).all():
            sweep = replace(sweep, felt=in_contact[strain_map.nearest(sweep.truth)])
        sweeps.append(sweep)
    return replace(recording, sweeps=tuple(sweeps))


def summarize(scene: Scene, tracks: Sequence[Track]) -> dict[str, Any]:
    """Summary of the tracks by name, in SI units; ``None`` where unknown.

    ``error_contact_m`` is from contact to the end of the feature (:func:`with_contact`). If the contact of
    any sweep is known, travel is counted from contact, and sweeps without contact do not count.
    """
    errors = [position_error(scene, track) for track in tracks]
    converged = [track.converged for track in tracks]
    has_contact = [track.contact[0] >= 0 for track in tracks]
    counts = [index for index, one in enumerate(has_contact) if one or not any(has_contact)]
    after = [errors[index] for index in counts], [tracks[index] for index in counts]
    marks = [mark for mark in ((0.0,) if any(has_contact) else ()) + MARKS if len(error_at(*after, mark))]
    arrived = travel_to_convergence(tracks)
    summary = {
        "sweeps": len(tracks),
        "strains": sum(map(len, tracks)),
        "measurement_updates": int(sum(track.updated.sum() for track in tracks)),
        "refused": sum(track.refused for track in tracks),
        "error_m": statistics(_pooled(errors)),
        "contacts": sum(has_contact),
        "error_contact_m": statistics(_pooled(errors, [track.on_contact for track in tracks])),
        "error_converged_m": statistics(_pooled(errors, converged)),
        "error_after_travel_m": {f"{mark:g}": statistics(error_at(*after, mark)) for mark in marks},
        "final_error_m": statistics(np.array([error[-1] for error in errors if len(error)])),
        **calibration(scene, tracks),
        "converged_sweeps": int(np.isfinite(arrived).sum()),
        "converged_fraction": float(np.mean(np.concatenate(converged))) if any(map(len, tracks)) else None,
        "travel_to_convergence_m": statistics(arrived),
    }
    if "yaw" in scene.axis_names:
        summary["error_rad"] = statistics(_pooled([yaw_error(scene, track) for track in tracks]))
    return summary


def timing(tracks: Sequence[Track]) -> dict[str, Any]:
    """Computing time per measurement update, per sample and per millimetre of travel, µs."""
    updates = _pooled([track.seconds for track in tracks], [track.updated for track in tracks]) * 1e6
    every = _pooled([track.seconds for track in tracks]) * 1e6
    travel_mm = 1e3 * sum(float(track.travel[-1]) for track in tracks if len(track))
    if not len(updates):
        return dict.fromkeys(("update_median_us", "update_p99_us", "strain_mean_us", "us_per_mm"))
    return {
        "update_median_us": float(np.median(updates)),
        "update_p99_us": float(np.quantile(updates, 0.99)),
        "strain_mean_us": float(np.mean(every)),
        "us_per_mm": float(every.sum() / travel_mm) if travel_mm > 0.0 else None,
    }


def wrong_sweeps(scene: Scene, tracks: Sequence[Track], radius: float) -> dict[int, float]:
    """Sweeps whose median error while converged exceeds ``radius``, m, by number with that error, m."""
    wrong = {}
    for track in tracks:
        errors = position_error(scene, track)[track.converged]
        error = float(np.median(errors[np.isfinite(errors)])) if np.isfinite(errors).any() else 0.0
        if error > radius:
            wrong[track.number] = error
    return wrong


def _pooled(values: Sequence[np.ndarray], keep: Sequence[np.ndarray] | None = None) -> np.ndarray:
    """Finite values of all tracks, of the entries selected by ``keep``."""
    if not values:
        return np.empty(0)
    pooled = np.concatenate(values)
    if keep is not None:
        pooled = pooled[np.concatenate(keep)]
    return pooled[np.isfinite(pooled)]
