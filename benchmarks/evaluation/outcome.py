"""Outcome of one sweep as plain numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from tactile_localizer.offline.metrics import (
    MARKS,
    SQUARED_95,
    error_at,
    position_error,
    squared_mahalanobis,
)
from tactile_localizer.offline.replay import Track
from tactile_localizer.scene import Scene


def sweep_outcome(scene: Scene, track: Track) -> dict[str, Any]:
    """Outcome of a sweep with known truth."""
    during = track.on_contact
    errors, squared = position_error(scene, track), squared_mahalanobis(scene, track)
    covered = (squared <= SQUARED_95[scene.dimension]).astype(float)
    return {
        "number": track.number,
        "error_m": mean(errors),
        "error_contact_m": mean(errors[during]),
        "final_error_m": mean(errors[-1:]),
        "coverage": mean(covered),
        "coverage_contact": mean(covered[during]),
        "nees": mean(squared / scene.dimension),
        "nees_contact": mean(squared[during] / scene.dimension),
        **_convergence(track, errors),
        "error_after_travel_m": {
            f"{mark:g}": float(error) for mark in MARKS for error in error_at([errors], [track], mark)
        },
    }


def mean(values: np.ndarray) -> float | None:
    """Mean of the finite values; ``None`` if there are none."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else None


def _convergence(track: Track, errors: np.ndarray) -> dict[str, Any]:
    (first, last), start = track.contact, track.start
    end = int(np.searchsorted(track.row, last, side="right")) if first >= 0 else len(track)
    at = np.flatnonzero(track.converged)
    found: dict[str, Any] = {
        "converged_before": bool(first >= 0 and (at < start).any()),
        "converged": bool(((at >= start) & (at < end)).any()),
        "travel_to_convergence_m": None,
        "time_to_convergence_s": None,
        "error_converged_m": mean(errors[at]),
    }
    if len(at) and at[0] < end:
        found["travel_to_convergence_m"] = float(track.travel[at[0]] - track.travel[start])
        found["time_to_convergence_s"] = 1e-9 * float(track.stamp_ns[at[0]] - track.stamp_ns[start])
    return found
