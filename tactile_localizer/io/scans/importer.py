"""Import of a recording into a new scan, with the same pairs as live recording would store."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from tactile_localizer.errors import ScanError, listed
from tactile_localizer.io.recording import OUTSIDE, USABLE, Recording, gap_notes, screen, unusable
from tactile_localizer.io.scans.folder import SESSIONS, require_new
from tactile_localizer.io.scans.writer import ScanWriter
from tactile_localizer.io.status import MISSING, SATURATED
from tactile_localizer.scene import Scene


def import_recording(
    recording: Recording,
    scene: Scene,
    path: str | Path,
    *,
    what: str = "import",
    detail: Mapping[str, Any] | None = None,
    force: bool = False,
) -> tuple[str, ...]:
    """Make a scan of a recording.

    The folder appears under its name only when it is complete.

    Parameters
    ----------
    recording : recording with the axes and phalanges of ``scene``
    scene : stored in the scan; samples outside its bounds are skipped
    path : must not exist yet; missing parent folders are created
    what, detail : entry of the scan's history
    force : whether to accept a recording of which less than half of the samples can be used

    Returns
    -------
    tuple
        One line per reason for which samples were skipped.

    Raises
    ------
    ScanError
        The folder exists or cannot be written; two sweeps hold the same pairs; no sample can be used, or,
        without ``force``, less than half.
    """
    known: dict[int, int] = {}
    for sweep in recording.sweeps:
        require_new(sweep, known, recording.source)
    reasons = [screen(scene, sweep.position, sweep.strain, sweep.status) for sweep in recording.sweeps]
    notes = (*recording.notes, *_skipped_notes(recording, scene, reasons))
    kept = sum(int(np.count_nonzero(each == USABLE)) for each in reasons)
    total = len(recording) + recording.lost + sum(sweep.gaps for sweep in recording.sweeps)
    if not kept or (2 * kept < total and not force):
        expected = f"expected at least half of {total} samples to be usable, found {kept}"
        expected = (
            f"{expected} (--force imports them nevertheless)" if kept else "expected samples, found none"
        )
        raise unusable(recording, notes, expected)
    path = Path(path)
    try:
        if path.exists():
            raise ScanError(f"{path}: expected no folder of this name, found one; choose another name")
        path.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix=".", dir=path.parent) as folder:
            with ScanWriter(Path(folder, path.name), scene) as writer:
                for sweep, reason in zip(recording.sweeps, reasons, strict=True):
                    usable = sweep.part(reason == USABLE, sweep.number, sweep.gaps)
                    if len(usable):
                        writer.add(replace(usable, skipped=len(sweep) - len(usable)))
                sessions = {SESSIONS: list(recording.sessions)} if recording.sessions else {}
                writer.note(what, **(detail or {}), **sessions, notes=list(notes))
            writer.path.rename(path)
    except OSError as error:
        raise ScanError(f"{path}: expected a writable folder, {error.strerror}") from None
    except ScanError as error:  # that names the folder which the user knows
        raise ScanError(re.sub(r"/\.\w+(?=/)", "", str(error), count=1)) from None
    return notes


def _skipped_notes(recording: Recording, scene: Scene, reasons: Sequence[np.ndarray]) -> Iterator[str]:
    """One line per reason for which samples are skipped."""
    gaps = sum(sweep.gaps for sweep in recording.sweeps)
    position = np.concatenate(
        [np.empty((0, scene.dimension)), *(sweep.position for sweep in recording.sweeps)]
    )
    low, high = position.min(axis=0, initial=np.inf), position.max(axis=0, initial=-np.inf)
    ranges = "; ".join(
        f"{axis.name} is {least:.6g} to {most:.6g}, bounds {axis.lower:.6g} to {axis.upper:.6g}"
        for axis, least, most in zip(scene.axes, low, high, strict=True)
    )
    for excluded, what in (
        (OUTSIDE, f"with a palm position outside the scene's bounds ({ranges})"),
        (MISSING, "with missing or implausibly large strain"),
        (SATURATED, "with saturated strain"),
    ):
        if count := sum(int(np.count_nonzero(each == excluded)) for each in reasons):
            yield f"skipped {count} of {len(recording) + gaps} samples {what}"
    yield from gap_notes(recording)
    each = zip(recording.sweeps, reasons, strict=True)
    empty = [str(sweep.number) for sweep, reason in each if not (reason == USABLE).any()]
    if 0 < len(empty) < len(reasons):
        yield f"no pairs: sweep {listed(empty)}"
