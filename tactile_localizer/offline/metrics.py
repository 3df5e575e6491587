"""Metrics of a replay: error, consistency of the covariance, convergence, computing time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.likelihood.strain_map import StrainMap
from tactile_localizer.io.recording import Recording
from tactile_localizer.offline.replay import ReplayedSweep
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


def position_error(scene: Scene, sweep: ReplayedSweep) -> np.ndarray:
    """Distance between estimate and truth without the yaw, (n,) m; NaN where unknown."""
    lengths = np.array([axis.name != "yaw" for axis in scene.axes])
    if sweep.truth is None or not lengths.any():
        return np.full(len(sweep), np.nan)
    return np.linalg.norm(deviation(scene, sweep.mean, sweep.truth)[:, lengths], axis=1)


def yaw_error(scene: Scene, sweep: ReplayedSweep) -> np.ndarray:
    """Absolute error of the yaw, (n,) rad; NaN where there is no yaw or no truth."""
    if sweep.truth is None or "yaw" not in scene.axis_names:
        return np.full(len(sweep), np.nan)
    return np.abs(deviation(scene, sweep.mean, sweep.truth)[:, scene.axis_names.index("yaw")])


def squared_mahalanobis(scene: Scene, sweep: ReplayedSweep) -> np.ndarray:
    """Squared Mahalanobis distance between estimate and truth, (n,); d on average if consistent."""
    if sweep.truth is None:
        return np.full(len(sweep), np.nan)
    difference = deviation(scene, sweep.mean, sweep.truth)
    values, vectors = np.linalg.eigh(sweep.covariance)
    along = np.einsum("ndk,nd->nk", vectors, difference)
    return np.sum(along**2 / np.maximum(values, _MIN_VARIANCE), axis=1)


def calibration(scene: Scene, sweeps: Sequence[ReplayedSweep]) -> dict[str, Any]:
    """Normalized estimation error squared (NEES) per degree of freedom, and coverage of the 95 % region."""
    squared = _pooled([squared_mahalanobis(scene, sweep) for sweep in sweeps])
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


def error_at(errors: Sequence[np.ndarray], sweeps: Sequence[ReplayedSweep], mark: float) -> np.ndarray:
    """Errors of the sweeps that are long enough after ``mark`` m of :func:`travel_from_contact`."""
    found = []
    for error, sweep in zip(errors, sweeps, strict=True):
        travel = travel_from_contact(sweep)
        if len(sweep) and travel[-1] >= mark - _ROUNDING:
            found.append(error[np.searchsorted(travel, mark - _ROUNDING)])
    return np.array(found)


def travel_from_contact(sweep: ReplayedSweep) -> np.ndarray:
    """Travel from contact, (n,) m, negative before it; from the start of a sweep without contact."""
    return sweep.travel - sweep.travel[sweep.start] if len(sweep) else sweep.travel


def travel_to_convergence(sweeps: Sequence[ReplayedSweep]) -> np.ndarray:
    """:func:`travel_from_contact` of each sweep's first converged entry; NaN where it never converged."""
    return np.array(
        [
            travel_from_contact(sweep)[np.argmax(sweep.converged)] if sweep.converged.any() else np.nan
            for sweep in sweeps
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


def summarize(scene: Scene, sweeps: Sequence[ReplayedSweep]) -> dict[str, Any]:
    """Summary of the sweeps by name, in SI units; ``None`` where unknown.

    ``error_contact_m`` is from contact to the end of the feature (:func:`with_contact`). If the contact of
    any sweep is known, travel is counted from contact, and sweeps without contact do not count.
    """
    errors = [position_error(scene, sweep) for sweep in sweeps]
    converged = [sweep.converged for sweep in sweeps]
    has_contact = [sweep.contact[0] >= 0 for sweep in sweeps]
    counts = [index for index, one in enumerate(has_contact) if one or not any(has_contact)]
    after = [errors[index] for index in counts], [sweeps[index] for index in counts]
    marks = [mark for mark in ((0.0,) if any(has_contact) else ()) + MARKS if len(error_at(*after, mark))]
    arrived = travel_to_convergence(sweeps)
    summary = {
        "sweeps": len(sweeps),
        "strains": sum(map(len, sweeps)),
        "measurement_updates": int(sum(sweep.updated.sum() for sweep in sweeps)),
        "refused": sum(sweep.refused for sweep in sweeps),
        "error_m": statistics(_pooled(errors)),
        "contacts": sum(has_contact),
        "error_contact_m": statistics(_pooled(errors, [sweep.on_contact for sweep in sweeps])),
        "error_converged_m": statistics(_pooled(errors, converged)),
        "error_after_travel_m": {f"{mark:g}": statistics(error_at(*after, mark)) for mark in marks},
        "final_error_m": statistics(np.array([error[-1] for error in errors if len(error)])),
        **calibration(scene, sweeps),
        "converged_sweeps": int(np.isfinite(arrived).sum()),
        "converged_fraction": float(np.mean(np.concatenate(converged))) if any(map(len, sweeps)) else None,
        "travel_to_convergence_m": statistics(arrived),
    }
    if "yaw" in scene.axis_names:
        summary["error_rad"] = statistics(_pooled([yaw_error(scene, sweep) for sweep in sweeps]))
    return summary


def timing(sweeps: Sequence[ReplayedSweep]) -> dict[str, Any]:
    """Computing time per measurement update, per sample and per millimetre of travel, µs."""
    updates = _pooled([sweep.seconds for sweep in sweeps], [sweep.updated for sweep in sweeps]) * 1e6
    every = _pooled([sweep.seconds for sweep in sweeps]) * 1e6
    travel_mm = 1e3 * sum(float(sweep.travel[-1]) for sweep in sweeps if len(sweep))
    if not len(updates):
        return dict.fromkeys(("update_median_us", "update_p99_us", "strain_mean_us", "us_per_mm"))
    return {
        "update_median_us": float(np.median(updates)),
        "update_p99_us": float(np.quantile(updates, 0.99)),
        "strain_mean_us": float(np.mean(every)),
        "us_per_mm": float(every.sum() / travel_mm) if travel_mm > 0.0 else None,
    }


def _pooled(values: Sequence[np.ndarray], keep: Sequence[np.ndarray] | None = None) -> np.ndarray:
    """Finite values of all sweeps, of the entries selected by ``keep``."""
    if not values:
        return np.empty(0)
    pooled = np.concatenate(values)
    if keep is not None:
        pooled = pooled[np.concatenate(keep)]
    return pooled[np.isfinite(pooled)]
