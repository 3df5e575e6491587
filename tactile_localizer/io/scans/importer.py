"""A recording into a new scan file: the same pairs that recording live would have kept."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import Recording, Screening, screen
from tactile_localizer.io.scans.store import new_scan
from tactile_localizer.scene import Scene

_NAMED = 10
"""Sweeps that a message names at most."""


@dataclass(frozen=True)
class ImportReport:
    """What an import kept and what it left out.

    Parameters
    ----------
    sweeps, pairs : how many the scan file holds
    notes : one line for each kind of sample that was left out
    """

    sweeps: int
    pairs: int
    notes: tuple[str, ...]


def import_recording(
    recording: Recording,
    scene: Scene,
    path: str | Path,
    *,
    what: str,
    detail: dict[str, Any],
    strain_unit: str = "V",
    force: bool = False,
) -> ImportReport:
    """Make a scan file of a recording.

    The file appears under its name only when it is complete, and holds at least half of the samples.

    Parameters
    ----------
    recording : read for the same scene
    scene : kept in the file; its bounds say which samples are kept
    path : must not exist yet
    what, detail : entry of the file's history
    strain_unit : what the strain values are, for people
    force : make the scan even where less than half of the samples can be used

    Raises
    ------
    ScanError
        The file exists or cannot be written, or no sample, or without ``force`` less than half, can be used.
    """
    screenings = [screen(scene, sweep.position, sweep.strain, sweep.status) for sweep in recording.sweeps]
    notes = (*recording.notes, *_left_out(recording, scene, screenings))
    kept = sum(int(np.count_nonzero(screening.keep)) for screening in screenings)
    total = len(recording) + recording.lost + sum(sweep.gaps for sweep in recording.sweeps)
    if kept and 2 * kept < total and not force:
        raise ScanError(
            f"{recording.source}: expected to keep at least half of {total} samples, would keep {kept} "
            f"(--force makes the scan all the same): {'; '.join(notes)}"
        )
    with new_scan(path, scene, strain_unit=strain_unit) as store:
        for sweep, screening in zip(recording.sweeps, screenings, strict=True):
            keep = screening.keep
            if keep.any():
                store.begin_sweep(sweep.number)
                store.append(sweep.stamp_ns[keep], sweep.position[keep], sweep.strain[keep])
                store.end_sweep(gaps=sweep.gaps, skipped=screening.skipped)
        sweeps, pairs = len(store.sweeps()), store.pairs
        store.note(what, {**detail, "notes": list(notes)})
        if not pairs:
            raise ScanError(
                f"{recording.source}: expected samples for a scan; {'; '.join(notes) or 'found none'}"
            )
    return ImportReport(sweeps, pairs, notes)


def _left_out(recording: Recording, scene: Scene, screenings: Sequence[Screening]) -> Iterator[str]:
    """What the screening of the sweeps leaves out, one line a reason."""
    gaps = sum(sweep.gaps for sweep in recording.sweeps)
    reasons = {
        f"with a palm position outside the scene's bounds{_reach(recording, scene)}": sum(
            screening.outside for screening in screenings
        ),
        "with missing strain, or strain of impossible size": sum(
            screening.missing for screening in screenings
        ),
        "with saturated strain": sum(screening.saturated for screening in screenings),
        "without a palm pose near enough in time": gaps,
    }
    for reason, count in reasons.items():
        if count:
            yield f"left out {count} of {len(recording) + gaps} samples {reason}"
    empty = [
        sweep.number
        for sweep, screening in zip(recording.sweeps, screenings, strict=True)
        if not screening.keep.any()
    ]
    if empty:
        numbers = ", ".join(map(str, empty[:_NAMED])) + (", ..." if len(empty) > _NAMED else "")
        yield f"left out {len(empty)} of {len(recording.sweeps)} sweeps whole: {numbers}"


def _reach(recording: Recording, scene: Scene) -> str:
    """How far positions go on the axes on which they leave the bounds."""
    if not len(recording):
        return ""
    position = np.concatenate([sweep.position for sweep in recording.sweeps])
    reach = [
        f"{axis.name} is {low:.6g} to {high:.6g}, bounds {axis.lower:.6g} to {axis.upper:.6g}"
        for axis, low, high in zip(scene.axes, position.min(axis=0), position.max(axis=0), strict=True)
        if low < axis.lower or high > axis.upper
    ]
    return f" ({'; '.join(reach)})" if reach else ""
