"""Import of a recording into a new scan, with the same pairs as live recording would store."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import Recording, Screening, screen
from tactile_localizer.io.scans.folder import require_distinct
from tactile_localizer.io.scans.writer import new_scan
from tactile_localizer.scene import Scene

_MAX_NAMED_SWEEPS = 10
"""Most sweeps named in a message."""


@dataclass(frozen=True)
class ImportReport:
    """Result of an import.

    Parameters
    ----------
    sweeps, pairs : numbers of sweeps and pairs in the scan
    notes : one line per reason for which samples were skipped
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
    """Make a scan of a recording.

    The folder appears under its name only when it is complete.

    Parameters
    ----------
    recording : recording with the axes and phalanges of ``scene``
    scene : stored in the scan; samples outside its bounds are skipped
    path : must not exist yet
    what, detail : entry of the scan's history
    strain_unit : unit of the strain values, for display
    force : whether to accept a recording of which less than half of the samples can be used

    Raises
    ------
    ScanError
        The folder exists or cannot be written; two sweeps hold the same pairs; no sample can be used, or,
        without ``force``, less than half.
    """
    require_distinct(
        recording.sweeps, f"{recording.source}: expected every sweep once", "is a recording given twice?"
    )
    screenings = [screen(scene, sweep.position, sweep.strain, sweep.status) for sweep in recording.sweeps]
    notes = (*recording.notes, *_skipped_notes(recording, scene, screenings))
    kept = sum(int(np.count_nonzero(screening.keep)) for screening in screenings)
    total = len(recording) + recording.lost + sum(sweep.gaps for sweep in recording.sweeps)
    if kept and 2 * kept < total and not force:
        raise ScanError(
            f"{recording.source}: expected at least half of {total} samples to be usable, found {kept} "
            f"(--force imports them nevertheless): {'; '.join(notes)}"
        )
    if not kept:
        raise ScanError(f"{recording.source}: expected usable samples; {'; '.join(notes) or 'found none'}")
    sweeps = 0
    with new_scan(path, scene, strain_unit=strain_unit) as writer:
        for sweep, screening in zip(recording.sweeps, screenings, strict=True):
            keep = screening.keep
            if keep.any():
                usable = sweep.part(keep, sweep.number, sweep.gaps)
                writer.add(replace(usable, skipped=screening.skipped))
                sweeps += 1
        writer.note(what, **detail, notes=list(notes))
    return ImportReport(sweeps, kept, notes)


def _skipped_notes(recording: Recording, scene: Scene, screenings: Sequence[Screening]) -> Iterator[str]:
    """One line per reason for which samples are skipped."""
    gaps = sum(sweep.gaps for sweep in recording.sweeps)
    reasons = {
        f"with a palm position outside the scene's bounds{_range_note(recording, scene)}": sum(
            screening.outside for screening in screenings
        ),
        "with missing or implausibly large strain": sum(screening.missing for screening in screenings),
        "with saturated strain": sum(screening.saturated for screening in screenings),
        "without a palm pose close enough in time": gaps,
    }
    for reason, count in reasons.items():
        if count:
            yield f"skipped {count} of {len(recording) + gaps} samples {reason}"
    empty = [
        sweep.number
        for sweep, screening in zip(recording.sweeps, screenings, strict=True)
        if not screening.keep.any()
    ]
    if empty:
        numbers = ", ".join(map(str, empty[:_MAX_NAMED_SWEEPS])) + (
            ", ..." if len(empty) > _MAX_NAMED_SWEEPS else ""
        )
        yield f"skipped {len(empty)} of {len(recording.sweeps)} sweeps completely: {numbers}"


def _range_note(recording: Recording, scene: Scene) -> str:
    """Range of the positions on each axis on which they exceed the bounds."""
    if not len(recording):
        return ""
    position = np.concatenate([sweep.position for sweep in recording.sweeps])
    ranges = [
        f"{axis.name} is {low:.6g} to {high:.6g}, bounds {axis.lower:.6g} to {axis.upper:.6g}"
        for axis, low, high in zip(scene.axes, position.min(axis=0), position.max(axis=0), strict=True)
        if low < axis.lower or high > axis.upper
    ]
    return f" ({'; '.join(ranges)})" if ranges else ""
