"""A recording into a new scan file: the same pairs that recording live would have kept."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import Recording, screen
from tactile_localizer.io.scan_store import ScanStore
from tactile_localizer.scene import Scene


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
) -> ImportReport:
    """Make a scan file of a recording.

    The file appears under its name only when it is complete.

    Parameters
    ----------
    recording : read for the same scene
    scene : kept in the file; its bounds say which samples are kept
    path : must not exist yet
    what, detail : entry of the file's history
    strain_unit : what the strain values are, for people

    Raises
    ------
    ScanError
        The file exists or cannot be written, or no sample can be used.
    """
    path = Path(path)
    if path.exists():
        raise ScanError(f"{path}: expected no file of this name yet, found one")
    unfinished = path.with_name(f"{path.name}.part")
    unfinished.unlink(missing_ok=True)
    missing = saturated = outside = gaps = 0
    try:
        with ScanStore.create(unfinished, scene, strain_unit=strain_unit) as store:
            for sweep in recording.sweeps:
                screening = screen(scene, sweep.position, sweep.strain, sweep.status)
                missing += screening.missing
                saturated += screening.saturated
                outside += screening.outside
                gaps += sweep.gaps
                keep = screening.keep
                if keep.any():
                    store.begin_sweep(sweep.number)
                    store.append(sweep.stamp_ns[keep], sweep.position[keep], sweep.strain[keep])
                    store.end_sweep(gaps=sweep.gaps, skipped=screening.skipped)
            sweeps, pairs = len(store.sweeps()), store.pairs
            store.note(what, {**detail, "notes": list(recording.notes)})
        reasons = {
            "with a palm position outside the scene's bounds": outside,
            "with missing strain": missing,
            "with saturated strain": saturated,
            "without a palm pose near enough in time": gaps,
        }
        notes = recording.notes + tuple(
            f"left out {count} of {len(recording) + gaps} samples {reason}"
            for reason, count in reasons.items()
            if count
        )
        if not pairs:
            raise ScanError(
                f"{recording.source}: expected samples for a scan; {'; '.join(notes) or 'found none'}"
            )
        unfinished.rename(path)
    finally:
        unfinished.unlink(missing_ok=True)
    return ImportReport(sweeps, pairs, notes)
