"""Import of a recording into a new scan, with the same pairs as live recording would store."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import OUTSIDE, USABLE, Recording, screen
from tactile_localizer.io.scans.folder import require_distinct
from tactile_localizer.io.scans.writer import new_scan
from tactile_localizer.io.status import MISSING, SATURATED
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
    reasons = [screen(scene, sweep.position, sweep.strain, sweep.status) for sweep in recording.sweeps]
    notes = (*recording.notes, *_skipped_notes(recording, scene, reasons))
    kept = sum(int(np.count_nonzero(each == USABLE)) for each in reasons)
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
        for sweep, reason in zip(recording.sweeps, reasons, strict=True):
            usable = sweep.part(reason == USABLE, sweep.number, sweep.gaps)
            if len(usable):
                writer.add(replace(usable, skipped=len(sweep) - len(usable)))
                sweeps += 1
        writer.note(what, **detail, notes=list(notes))
    return ImportReport(sweeps, kept, notes)


def _skipped_notes(recording: Recording, scene: Scene, reasons: Sequence[np.ndarray]) -> Iterator[str]:
    """One line per reason for which samples are skipped."""
    gaps = sum(sweep.gaps for sweep in recording.sweeps)
    counts = Counter(reason for each in reasons for reason in each.tolist())
    for count, what in (
        (counts[OUTSIDE], f"with a palm position outside the scene's bounds{_range_note(recording, scene)}"),
        (counts[MISSING], "with missing or implausibly large strain"),
        (counts[SATURATED], "with saturated strain"),
        (gaps, "without a palm pose close enough in time"),
    ):
        if count:
            yield f"skipped {count} of {len(recording) + gaps} samples {what}"
    sweeps = zip(recording.sweeps, reasons, strict=True)
    empty = [sweep.number for sweep, reason in sweeps if USABLE not in reason]
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
