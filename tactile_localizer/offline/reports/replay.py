"""JSON document of a replay: summary, settings and every update."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.io.recording import Recording
from tactile_localizer.io.scene_file import scene_to_dict
from tactile_localizer.offline.json_file import plain_columns
from tactile_localizer.offline.metrics import position_error, summarize, timing, yaw_error
from tactile_localizer.offline.replay import Track
from tactile_localizer.scene import Scene


def replay_document(
    scene: Scene,
    configuration: Configuration,
    recording: Recording,
    tracks: Sequence[Track],
    learned: Mapping[str, str],
    *,
    odometry: str,
    seed: int,
) -> dict[str, Any]:
    """Document of a replay; all but ``timing`` is reproducible for a seed.

    Parameters
    ----------
    scene : of the localizer
    recording : that was replayed; ``odometry`` names the kind of its positions
    learned : values learned from the scan, by name
    """
    return {
        "summary": {"scene": scene.name, "odometry": odometry, "seed": seed, **summarize(scene, tracks)},
        "timing": timing(tracks),
        "recording": {"source": recording.source, "notes": recording.notes},
        "configuration": configuration,
        "learned": dict(learned),
        "scene": scene_to_dict(scene),
        "axes": scene.axis_names,
        "updates": [update for track in tracks for update in _updates(scene, track)],
    }


def _updates(scene: Scene, track: Track) -> Iterator[dict[str, Any]]:
    columns: dict[str, Any] = {
        "stamp_s": [stamp_ns / 1e9 for stamp_ns in track.stamp_ns.tolist()],
        "stamp_ns": track.stamp_ns,
        "sweep": [track.number] * len(track),
        "mean": track.mean,
        "covariance": track.covariance,
        "trace": track.trace,
        "converged": track.converged,
        "state": [state.value for state in track.state],
        "reason": list(track.reason),
        "probability": track.probability,
        "on_map": track.on_map,
        "log_marginal": track.log_marginal,
        "updated": track.updated,
        "travel_m": track.travel,
        "truth": _known(track),
        "error_m": position_error(scene, track),
    }
    if "yaw" in scene.axis_names:
        columns["error_rad"] = yaw_error(scene, track)
    return plain_columns(columns)


def _known(track: Track) -> list[list[float] | None]:
    """True positions; ``None`` where an axis is unknown."""
    if track.truth is None:
        return [None] * len(track)
    known = np.isfinite(track.truth).all(axis=1).tolist()
    return [place if is_known else None for place, is_known in zip(track.truth.tolist(), known, strict=True)]
