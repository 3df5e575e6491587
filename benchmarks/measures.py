"""Measures of localized sweeps whose true positions and contact with a feature are known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tactile_localizer.offline.metrics import (
    SQUARED_95,
    position_error,
    squared_mahalanobis,
    travel_from_contact,
)
from tactile_localizer.offline.replay import Track
from tactile_localizer.scene import Scene

Row = dict[str, Any]

SETTLED_M = 0.004
"""Travel from contact after which an error counts as settled, m."""


def on_feature(scene: Scene, tracks: Sequence[Track]) -> Row:
    """Error, coverage and convergence of sweeps over the scanned feature.

    Errors and coverages are means over the sweeps of the mean over the strains concerned; a sweep without
    contact has none of them on contact, and all of it lies before contact.
    """
    errors = [position_error(scene, track) for track in tracks]
    covered = [squared_mahalanobis(scene, track) <= SQUARED_95[scene.dimension] for track in tracks]
    contacts = [track.on_contact for track in tracks]
    settled = [
        during & (travel_from_contact(track) >= SETTLED_M)
        for track, during in zip(tracks, contacts, strict=True)
    ]
    travel = np.array([_travel_to_convergence(track) for track in tracks])
    return {
        "error_mm": 1e3 * _mean_of_sweeps(errors, contacts),
        "error_settled_mm": 1e3 * _mean_of_sweeps(errors, settled),
        "coverage": _mean_of_sweeps(covered, [np.ones(len(track), dtype=bool) for track in tracks]),
        "coverage_contact": _mean_of_sweeps(covered, contacts),
        "within_5_mm": float(np.mean(travel <= 0.005)),
        "within_10_mm": float(np.mean(travel <= 0.010)),
        "false_before": sum(bool((track.converged & ~_from_contact(track)).any()) for track in tracks),
    }


def falsely_converged(scene: Scene, tracks: Sequence[Track], radius: float) -> Row:
    """Convergence on a wrong place: an error of more than ``radius`` m.

    ``false_sweeps`` is the share of the sweeps in which that is the case after any strain from contact on,
    ``false_strains`` the share of all converged strains.
    """
    wrong = [track.converged & (position_error(scene, track) > radius) for track in tracks]
    converged = sum(int(track.converged.sum()) for track in tracks)
    return {
        "false_sweeps": float(
            np.mean(
                [(flags & _from_contact(track)).any() for flags, track in zip(wrong, tracks, strict=True)]
            )
        ),
        "false_strains": sum(int(flags.sum()) for flags in wrong) / converged if converged else 0.0,
    }


def on_unscanned(tracks: Sequence[Track]) -> tuple[float, float]:
    """Shares of converged strains from contact on, and of the sweeps with such a strain.

    A sweep without contact counts from its start.
    """
    flags = [track.converged[track.row >= track.contact[0]] for track in tracks]
    return float(np.mean(np.concatenate(flags))), float(np.mean([sweep.any() for sweep in flags]))


def ever_converged(tracks: Sequence[Track]) -> int:
    """Number of sweeps in which any strain is converged."""
    return sum(bool(track.converged.any()) for track in tracks)


def update_times(tracks: Sequence[Track], read: float) -> Row:
    """Median times of measurement updates that are converged, and that are not, µs and in units of ``read``.

    Updates that do not occur have no time.
    """
    row: Row = {}
    for name, converged in (("update", True), ("update_open", False)):
        times = [track.seconds[track.updated & (track.converged == converged)] for track in tracks]
        seconds = np.concatenate(times)
        median = 1e6 * float(np.median(seconds)) if len(seconds) else None
        row[f"{name}_us"] = median
        row[f"{name}_reads"] = None if median is None else median / read
    return row


def _from_contact(track: Track) -> np.ndarray:
    """Strains from contact on, (n,) bool; none in a sweep without contact."""
    first = track.contact[0]
    return (track.row >= first) & (first >= 0)


def _travel_to_convergence(track: Track) -> float:
    """Travel from contact to the first converged strain, m; infinite where none is by the feature's end."""
    at = np.flatnonzero(track.converged & (track.row <= track.contact[1]))
    return float(travel_from_contact(track)[at[0]]) if len(at) else np.inf


def _mean_of_sweeps(values: Sequence[np.ndarray], keep: Sequence[np.ndarray]) -> float:
    """Mean over the sweeps of the mean of the kept values; NaN where none is kept."""
    means = [own[kept].mean() for own, kept in zip(values, keep, strict=True) if kept.any()]
    return float(np.mean(means)) if means else np.nan
