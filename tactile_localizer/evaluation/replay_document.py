"""A replay as one document: the summary, what it was made with, and every update."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.evaluation.metrics import position_error, summarize, timing, yaw_error
from tactile_localizer.evaluation.replay import Track
from tactile_localizer.io.recording import Recording
from tactile_localizer.io.scene_file import scene_to_dict
from tactile_localizer.scene import Scene


def replay_document(
    scene: Scene,
    configuration: Configuration,
    recording: Recording,
    tracks: Sequence[Track],
    *,
    odometry: str,
    seed: int,
) -> dict[str, Any]:
    """Everything about a replay; all but ``timing`` is the same each time for the same seed.

    Parameters
    ----------
    scene : with the parameters of the measurement model that were used
    recording : that was replayed; ``odometry`` says what its positions are
    """
    return {
        "summary": {"scene": scene.name, "odometry": odometry, "seed": seed, **summarize(scene, tracks)},
        "timing": timing(tracks),
        "recording": {"source": recording.source, "notes": recording.notes},
        "configuration": configuration,
        "scene": scene_to_dict(scene),
        "axes": scene.axis_names,
        "updates": [update for track in tracks for update in _updates(scene, track)],
    }


def _updates(scene: Scene, track: Track) -> Iterator[dict[str, Any]]:
    errors, yaw_errors, trace = position_error(scene, track), yaw_error(scene, track), track.trace
    with_yaw = "yaw" in scene.axis_names
    for i in range(len(track)):
        truth = None if track.truth is None or np.isnan(track.truth[i]).any() else track.truth[i]
        yield {
            "stamp_s": int(track.stamp_ns[i]) / 1e9,
            "stamp_ns": int(track.stamp_ns[i]),
            "sweep": track.number,
            "mean": track.mean[i],
            "covariance": track.covariance[i],
            "trace": trace[i],
            "converged": track.converged[i],
            "reason": track.reason[i],
            "evidence": track.evidence[i],
            "log_marginal": track.log_marginal[i],
            "updated": track.updated[i],
            "travel_m": track.travel[i],
            "truth": truth,
            "error_m": errors[i],
            **({"error_rad": yaw_errors[i]} if with_yaw else {}),
        }
