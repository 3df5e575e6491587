"""Outcome of one sweep as plain numbers, for evaluations to collect."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import chdtri

from tactile_localizer.offline.metrics import (
    CONFIDENCE,
    MARKS,
    error_at,
    position_error,
    squared_mahalanobis,
)
from tactile_localizer.offline.replay import Track
from tactile_localizer.scene import Scene

BINS = 50
"""Bins along the sweep axis in which errors are averaged for figures."""


def sweep_axis(scene: Scene, tracks: list[Track]) -> int:
    """Index of the axis along which the sweeps run: on which the truth spans most of the bounds."""
    spans = [np.ptp(track.truth, axis=0) for track in tracks if track.truth is not None and len(track)]
    return int(np.argmax(np.mean(spans, axis=0) / (scene.upper - scene.lower))) if spans else 0


def bin_edges(scene: Scene, axis: int) -> np.ndarray:
    """Edges of the bins, (BINS + 1,) m."""
    return np.linspace(scene.lower[axis], scene.upper[axis], BINS + 1)


def sweep_outcome(scene: Scene, track: Track, axis: int) -> dict[str, Any]:
    """Outcome of a sweep over a feature.

    Parameters
    ----------
    track : with a known truth
    axis : of the sweeps
    """
    first, last = track.contact
    before = track.row < first if first >= 0 else np.ones(len(track), dtype=bool)
    during = track.on_contact
    errors, trace = position_error(scene, track), track.trace
    covered = squared_mahalanobis(scene, track) <= chdtri(scene.dimension, 1.0 - CONFIDENCE)
    return {
        "number": track.number,
        "contact_m": _places(track, during, axis),
        "error_m": _mean(errors),
        "error_contact_m": _mean(errors[during]),
        "error_before_m": _mean(errors[before]),
        "final_error_m": _mean(errors[-1:]),
        "trace_before_m2": _mean(trace[before]),
        "coverage": _mean(covered.astype(float)),
        "coverage_contact": _mean(covered[during].astype(float)),
        "nees": _mean(squared_mahalanobis(scene, track) / scene.dimension),
        "nees_contact": _mean(squared_mahalanobis(scene, track)[during] / scene.dimension),
        **_convergence(track, errors, first, last),
        **_plain_criteria("before", track, before),
        **_plain_criteria("contact", track, during),
        "error_curve_m": _binned(scene, track, errors, axis),
        "trace_curve_m2": _binned(scene, track, trace, axis),
        "error_after_contact_m": _by_travel(track, errors, first, last),
        **_past(scene, track, errors, last),
        "error_after_travel_m": {
            f"{mark:g}": float(error) for mark in MARKS for error in error_at([errors], [track], mark)
        },
    }


def blank_outcome(track: Track) -> dict[str, Any]:
    """Outcome of a blank sweep: any convergence is false."""
    every = np.ones(len(track), dtype=bool)
    return {"converged": bool(track.converged.any()), **_plain_criteria("blank", track, every)}


def _convergence(track: Track, errors: np.ndarray, first: int, last: int) -> dict[str, Any]:
    start = track.start
    end = int(np.searchsorted(track.row, last, side="right")) if first >= 0 else len(track)
    at = np.flatnonzero(track.converged)
    known = len(track) > 0
    found: dict[str, Any] = {
        "converged_before": bool(first >= 0 and (at < start).any()),
        "converged": bool(((at >= start) & (at < end)).any()),
        "travel_to_convergence_m": None,
        "time_to_convergence_s": None,
        "error_at_convergence_m": None,
        "error_converged_m": _mean(errors[at]),
    }
    if len(at) and known and at[0] < end:
        found["travel_to_convergence_m"] = float(track.travel[at[0]] - track.travel[start])
        found["time_to_convergence_s"] = 1e-9 * float(track.stamp_ns[at[0]] - track.stamp_ns[start])
        found["error_at_convergence_m"] = _mean(errors[at[:1]])
    return found


def _plain_criteria(when: str, track: Track, part: np.ndarray) -> dict[str, Any]:
    """Quantities of the paper's plain criteria (III-D): lowest trace, highest marginal likelihood."""
    part = part & track.updated
    return {
        f"lowest_trace_{when}_m2": float(track.trace[part].min()) if part.any() else None,
        f"highest_marginal_{when}": float(track.log_marginal[part].max()) if part.any() else None,
    }


def _places(track: Track, part: np.ndarray, axis: int) -> list[float] | None:
    """First and last position on the sweep axis of a part of the track, m."""
    if track.truth is None or not part.any():
        return None
    return [float(place) for place in track.truth[part][[0, -1], axis]]


def _binned(scene: Scene, track: Track, values: np.ndarray, axis: int) -> list[float | None]:
    """Mean of ``values`` in each bin of the sweep axis."""
    if track.truth is None:
        return [None] * BINS
    place = np.digitize(track.truth[:, axis], bin_edges(scene, axis)) - 1
    return [_mean(values[place == index]) for index in range(BINS)]


TRAVEL_BINS_M = np.arange(0.0, 0.0301, 0.0025)
"""Edges of the bins of travel after contact, and after the feature's end, m."""


def _by_travel(track: Track, errors: np.ndarray, first: int, last: int) -> list[float | None]:
    """Mean error in each bin of travel after contact, up to the feature's end."""
    if first < 0 or not len(track):
        return [None] * (len(TRAVEL_BINS_M) - 1)
    travel = np.where(track.row <= last, track.travel - track.travel[track.start], -1.0)
    return _by_travel_bin(travel, errors)


def _past(scene: Scene, track: Track, errors: np.ndarray, last: int) -> dict[str, list[float | None]]:
    """Error in each bin of travel after the feature's end, and the error expected from motion noise alone.

    Motion noise adds the variance ``motion_std**2`` per metre to the error at the feature's end.
    """
    end = int(np.searchsorted(track.row, last, side="right")) - 1
    if last < 0 or end < 0:
        return {
            "error_past_m": [None] * (len(TRAVEL_BINS_M) - 1),
            "motion_past_m": [None] * (len(TRAVEL_BINS_M) - 1),
        }
    travel = track.travel - track.travel[end]
    travel[: end + 1] = -1.0
    lengths = np.array([axis.name != "yaw" for axis in scene.axes])
    variance = float(np.sum(scene.motion_std[lengths] ** 2))
    by_motion = np.sqrt(errors[end] ** 2 + variance * np.maximum(travel, 0.0))
    return {
        "error_past_m": _by_travel_bin(travel, errors),
        "motion_past_m": _by_travel_bin(travel, by_motion),
    }


def _by_travel_bin(travel: np.ndarray, values: np.ndarray) -> list[float | None]:
    place = np.digitize(travel, TRAVEL_BINS_M) - 1
    return [_mean(values[place == index]) for index in range(len(TRAVEL_BINS_M) - 1)]


def _mean(values: np.ndarray) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else None
