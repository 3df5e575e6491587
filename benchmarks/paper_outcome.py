"""Outcome of one sweep for the paper's figures and findings, as plain numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
from evaluation.comparison import Trial, replayed
from evaluation.outcome import mean, sweep_outcome
from scipy.special import chdtri

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import convergence_criteria
from tactile_localizer.offline.metrics import position_error, timing
from tactile_localizer.offline.replay import Track
from tactile_localizer.scene import Scene

BINS = 50
"""Bins along the sweep axis in which errors are averaged for figures."""

TRAVEL_BINS_M = np.arange(0.0, 0.0301, 0.0025)
"""Edges of the bins of travel after contact, and after the feature's end, m."""


def localize(trial: Trial) -> dict[str, Any]:
    """Outcomes of a condition's sweeps and blank sweeps, with the curves that the paper draws."""
    scene, tracks, blanks = replayed(trial)
    axis = sweep_axis(scene, tracks)
    return {
        "axis": scene.axis_names[axis],
        "edges_m": bin_edges(scene, axis).tolist(),
        "sweeps": [paper_outcome(scene, track, axis) for track in tracks],
        "blanks": [blank_outcome(track) for track in blanks],
        "narrow_trace_m2": narrow_trace(trial.configuration, scene),
        "timing": timing(tracks),
    }


def before_contact(track: Track) -> np.ndarray:
    """Which entries lie before contact, (n,) bool; all of a sweep without one."""
    first, _ = track.contact
    return track.row < first if first >= 0 else np.ones(len(track), dtype=bool)


def narrow_trace(configuration: Configuration, scene: Scene) -> float:
    """Trace of a normal belief that is just narrow enough for convergence on every axis."""
    criteria = convergence_criteria(scene, configuration)
    inside = chdtri(scene.dimension, 1.0 - criteria.probability)
    return float(np.sum(criteria.radius**2) / inside)


def sweep_axis(scene: Scene, tracks: list[Track]) -> int:
    """Index of the axis along which the sweeps run: on which the truth spans most of the bounds."""
    spans = [np.ptp(track.truth, axis=0) for track in tracks if track.truth is not None and len(track)]
    return int(np.argmax(np.mean(spans, axis=0) / scene.extent)) if spans else 0


def bin_edges(scene: Scene, axis: int) -> np.ndarray:
    """Edges of the bins, (BINS + 1,) m."""
    return np.linspace(scene.lower[axis], scene.upper[axis], BINS + 1)


def paper_outcome(scene: Scene, track: Track, axis: int) -> dict[str, Any]:
    """Outcome of a sweep over a feature.

    Parameters
    ----------
    track : with a known truth
    axis : of the sweeps
    """
    before, during = before_contact(track), track.on_contact
    errors, trace = position_error(scene, track), track.trace
    return {
        **sweep_outcome(scene, track),
        "contact_m": _places(track, during, axis),
        "error_before_m": mean(errors[before]),
        "trace_before_m2": mean(trace[before]),
        **_plain_criteria("before", track, before),
        **_plain_criteria("contact", track, during),
        "error_curve_m": _binned(scene, track, errors, axis),
        "trace_curve_m2": _binned(scene, track, trace, axis),
        "error_after_contact_m": _by_travel(track, errors),
        **past_feature(scene, track),
    }


def blank_outcome(track: Track) -> dict[str, Any]:
    """Outcome of a blank sweep: any convergence is false."""
    every = np.ones(len(track), dtype=bool)
    return {"converged": bool(track.converged.any()), **_plain_criteria("blank", track, every)}


def past_feature(scene: Scene, track: Track) -> dict[str, list[float | None]]:
    """Error in each bin of travel after the feature's end, and the error expected from motion noise alone.

    Motion noise adds the variance ``motion_std**2`` per metre to the error at the feature's end.
    """
    errors, last = position_error(scene, track), track.contact[1]
    end = int(np.searchsorted(track.row, last, side="right")) - 1
    if last < 0 or end < 0:
        nothing: list[float | None] = [None] * (len(TRAVEL_BINS_M) - 1)
        return {"error_past_m": nothing, "motion_past_m": nothing}
    travel = track.travel - track.travel[end]
    travel[: end + 1] = -1.0
    lengths = np.array([axis.name != "yaw" for axis in scene.axes])
    variance = float(np.sum(scene.motion_std[lengths] ** 2))
    by_motion = np.sqrt(errors[end] ** 2 + variance * np.maximum(travel, 0.0))
    return {
        "error_past_m": _by_travel_bin(travel, errors),
        "motion_past_m": _by_travel_bin(travel, by_motion),
    }


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
    return [mean(values[place == index]) for index in range(BINS)]


def _by_travel(track: Track, errors: np.ndarray) -> list[float | None]:
    """Mean error in each bin of travel after contact, up to the feature's end."""
    first, last = track.contact
    if first < 0 or not len(track):
        return [None] * (len(TRAVEL_BINS_M) - 1)
    travel = np.where(track.row <= last, track.travel - track.travel[track.start], -1.0)
    return _by_travel_bin(travel, errors)


def _by_travel_bin(travel: np.ndarray, values: np.ndarray) -> list[float | None]:
    place = np.digitize(travel, TRAVEL_BINS_M) - 1
    return [mean(values[place == index]) for index in range(len(TRAVEL_BINS_M) - 1)]
