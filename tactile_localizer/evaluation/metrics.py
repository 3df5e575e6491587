"""Numbers that say how well a recording was localised: error, calibration, convergence, time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.stats import chi2

from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.evaluation.replay import Track
from tactile_localizer.scene import Scene

INCH = 0.0254
"""m"""

MARKS = (0.0025, 0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64)
"""m of travel at which the error is told."""

CONFIDENCE = 0.95
"""Probability of the region whose coverage is measured."""


_NARROWEST = 1e-18
"""m2 (yaw: rad2); particles that have all become one believe in no width at all."""


def deviation(scene: Scene, mean: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Estimate less truth (n, d); an axis that is a full turn along the shortest arc."""
    difference = mean - truth
    difference[:, scene.wraps] = wrap_angle(difference[:, scene.wraps])
    return difference


def position_error(scene: Scene, track: Track) -> np.ndarray:
    """Distance of the estimate from the truth on the axes that are lengths, m: (n,); NaN where not known."""
    lengths = np.array([axis.name != "yaw" for axis in scene.axes])
    if track.truth is None or not lengths.any():
        return np.full(len(track), np.nan)
    return np.linalg.norm(deviation(scene, track.mean, track.truth)[:, lengths], axis=1)


def yaw_error(scene: Scene, track: Track) -> np.ndarray:
    """Absolute error of the yaw, rad: (n,); NaN where there is no yaw or no truth."""
    if track.truth is None or "yaw" not in scene.axis_names:
        return np.full(len(track), np.nan)
    return np.abs(deviation(scene, track.mean, track.truth)[:, scene.axis_names.index("yaw")])


def squared_mahalanobis(scene: Scene, track: Track) -> np.ndarray:
    """Squared error in units of the believed covariance (n,): d on average when the uncertainty is honest."""
    if track.truth is None:
        return np.full(len(track), np.nan)
    difference = deviation(scene, track.mean, track.truth)
    values, vectors = np.linalg.eigh(track.covariance)
    along = np.einsum("ndk,nd->nk", vectors, difference)
    return np.sum(along**2 / np.maximum(values, _NARROWEST), axis=1)


def calibration(
    scene: Scene, tracks: Sequence[Track], keep: Sequence[np.ndarray] | None = None
) -> dict[str, Any]:
    """Normalised estimation error squared a degree of freedom, and coverage of the 95 % region.

    ``keep``: which entries of each track count; by default all with a known truth.
    """
    squared = _pooled([squared_mahalanobis(scene, track) for track in tracks], keep)
    if not len(squared):
        return {"nees": None, "coverage_95": None}
    limit = chi2.ppf(CONFIDENCE, scene.dimension)
    return {
        "nees": float(np.mean(squared) / scene.dimension),
        "coverage_95": float(np.mean(squared <= limit)),
    }


def statistics(values: np.ndarray) -> dict[str, Any]:
    """Count, median, mean, 95th percentile and largest of the finite values; ``None`` for those of none."""
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
    """Error of each track that goes so far when it has travelled ``mark`` m."""
    mark -= 1e-9  # rounding of a sum of steps
    return np.array(
        [
            error[np.searchsorted(track.travel, mark)]
            for error, track in zip(errors, tracks, strict=True)
            if len(track) and track.travel[-1] >= mark
        ]
    )


def travel_to_convergence(tracks: Sequence[Track]) -> np.ndarray:
    """m of travel from a sweep's start to its first converged entry; NaN where it never converged."""
    return np.array(
        [track.travel[np.argmax(track.converged)] if track.converged.any() else np.nan for track in tracks]
    )


def summarize(scene: Scene, tracks: Sequence[Track]) -> dict[str, Any]:
    """All that can be said of the tracks, by name, in SI units; ``None`` for what is not known.

    *On the feature* means that some phalanx truly was in the scene's feature region.
    """
    errors = [position_error(scene, track) for track in tracks]
    converged = [track.converged for track in tracks]
    marks = [mark for mark in MARKS if len(error_at(errors, tracks, mark))]
    arrived = travel_to_convergence(tracks)
    summary = {
        "sweeps": len(tracks),
        "strains": sum(map(len, tracks)),
        "weighed": int(sum(track.updated.sum() for track in tracks)),
        "refused": sum(track.refused for track in tracks),
        "error_m": statistics(_pooled(errors)),
        "error_on_feature_m": None,
        "error_converged_m": statistics(_pooled(errors, converged)),
        "error_after_travel_m": {f"{mark:g}": statistics(error_at(errors, tracks, mark)) for mark in marks},
        "final_error_m": statistics(np.array([error[-1] for error in errors if len(error)])),
        **calibration(scene, tracks),
        "converged_sweeps": int(np.isfinite(arrived).sum()),
        "converged_share": float(np.mean(np.concatenate(converged))) if any(map(len, tracks)) else None,
        "travel_to_convergence_m": statistics(arrived),
    }
    if "yaw" in scene.axis_names:
        summary["error_rad"] = statistics(_pooled([yaw_error(scene, track) for track in tracks]))
    truths = [track.truth for track in tracks if track.truth is not None]
    if scene.feature is not None and len(truths) == len(tracks):
        on = [scene.on_feature(truth) for truth in truths]
        summary["error_on_feature_m"] = statistics(_pooled(errors, on))
    return summary


def timing(tracks: Sequence[Track]) -> dict[str, Any]:
    """What the localizer took, us: a weighed strain, any strain, and a millimetre of travel."""
    weighed = _pooled([track.seconds for track in tracks], [track.updated for track in tracks]) * 1e6
    every = _pooled([track.seconds for track in tracks]) * 1e6
    way = 1e3 * sum(float(track.travel[-1]) for track in tracks if len(track))
    if not len(weighed):
        return dict.fromkeys(("update_median_us", "update_p99_us", "strain_mean_us", "us_per_mm"))
    return {
        "update_median_us": float(np.median(weighed)),
        "update_p99_us": float(np.quantile(weighed, 0.99)),
        "strain_mean_us": float(np.mean(every)),
        "us_per_mm": float(every.sum() / way) if way > 0.0 else None,
    }


def _pooled(values: Sequence[np.ndarray], keep: Sequence[np.ndarray] | None = None) -> np.ndarray:
    """The finite values of all tracks, or those of them that ``keep`` marks."""
    if not values:
        return np.empty(0)
    pooled = np.concatenate(values)
    if keep is not None:
        pooled = pooled[np.concatenate(keep)]
    return pooled[np.isfinite(pooled)]
