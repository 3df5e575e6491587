"""JSON document of a replay: summary, settings, what was learned, and every update."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from tactile_localizer.core.calibration.held_out import Calibration
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.io.recording import Recording
from tactile_localizer.io.scene_file import scene_to_dict
from tactile_localizer.offline.axes import MM, display_units
from tactile_localizer.offline.metrics import position_error, summarize, timing, yaw_error
from tactile_localizer.offline.replay import Track
from tactile_localizer.scene import Scene

_BLOCK = 4096
"""Rows that are made at once."""


def learned_values(scene: Scene, model: SweepMixture, calibration: Calibration) -> dict[str, str]:
    """What was learned from a scan, by name, with units; the noise is in the unit of the scan's strain."""
    is_textured = model.map.featureless_variance is None
    memory = model.drift.memory
    noise = np.linalg.norm(np.linalg.inv(model.noise.whitening), axis=1)
    return {
        "material": "textured everywhere" if is_textured else "featureless between features",
        "information length": f"{calibration.information_length * MM:.1f} mm",
        "memory of the offset": f"{memory * MM:.0f} mm" if np.isfinite(memory) else "constant",
        "noise of a channel": f"{np.median(noise):.2g} ({noise.min():.2g} to {noise.max():.2g})",
        "registration": _sizes(scene, calibration.registration_std),
    }


def _sizes(scene: Scene, sizes: np.ndarray) -> str:
    """Lengths by axis, in display units."""
    return ", ".join(
        f"{axis} {display_units(axis, size):.2f}{'°' if axis == 'yaw' else ' mm'}"
        for axis, size in zip(scene.axis_names, sizes, strict=True)
    )


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
    """JSON document of a replay; all but ``timing`` is reproducible for a seed.

    Parameters
    ----------
    scene : scene of the localizer
    configuration : configuration of the localizer
    recording : replayed recording
    tracks : its replay
    learned : values learned from the scan, by name
    odometry : kind of the recording's positions
    seed : random seed
    """
    return {
        "summary": {"scene": scene.name, "odometry": odometry, "seed": seed, **summarize(scene, tracks)},
        "timing": timing(tracks),
        "recording": {"source": recording.source, "notes": recording.notes},
        "configuration": configuration,
        "learned": dict(learned),
        "scene": scene_to_dict(scene),
        "axes": scene.axis_names,
        "updates": updates(scene, tracks),
    }


def updates(scene: Scene, tracks: Sequence[Track]) -> Iterator[dict[str, Any]]:
    """Rows of all estimates of a replay, made in blocks: those of an hour take more than a gigabyte."""
    for track in tracks:
        errors, yaw_errors = position_error(scene, track), yaw_error(scene, track)
        for begin in range(0, len(track), _BLOCK):
            part = slice(begin, begin + _BLOCK)
            columns: dict[str, Any] = {
                "stamp_s": [stamp_ns / 1e9 for stamp_ns in track.stamp_ns[part].tolist()],
                "stamp_ns": track.stamp_ns[part],
                "sweep": [track.number] * len(track.stamp_ns[part]),
                "mean": track.mean[part],
                "covariance": track.covariance[part],
                "trace": track.trace[part],
                "converged": track.converged[part],
                "state": [state.value for state in track.state[part]],
                "reason": list(track.reason[part]),
                "probability": track.probability[part],
                "on_map": track.on_map[part],
                "log_marginal": track.log_marginal[part],
                "updated": track.updated[part],
                "travel_m": track.travel[part],
                "truth": _known(track, part),
                "error_m": errors[part],
            }
            if "yaw" in scene.axis_names:
                columns["error_rad"] = yaw_errors[part]
            for row in zip(*columns.values(), strict=True):
                yield dict(zip(columns, row, strict=True))


def _known(track: Track, part: slice) -> list[list[float] | None]:
    """True positions; ``None`` where one is unknown."""
    if track.truth is None:
        return [None] * len(track.stamp_ns[part])
    truth = track.truth[part]
    known = np.isfinite(truth).all(axis=1).tolist()
    return [place if is_known else None for place, is_known in zip(truth.tolist(), known, strict=True)]
