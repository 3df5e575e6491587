"""Repair of damaged scan files: undamaged rows go to a new file, and the damaged file is kept beside it."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tactile_localizer.errors import ScanError, SceneError
from tactile_localizer.io.scans.lock import ScanLock
from tactile_localizer.io.scans.pages import Pages, Place
from tactile_localizer.io.scans.rows import Batch, SweepInfo, header_seal, sweep_seal
from tactile_localizer.io.scans.store import ScanStore, new_scan, take_place
from tactile_localizer.io.scene_file import scene_from_dict
from tactile_localizer.scene import Scene

DAMAGED_SUFFIX = ".damaged"

_HEADER_KEYS = ("scene", "axes", "phalanges", "units", "contents", "seal")


@dataclass(frozen=True)
class RepairReport:
    """Result of a repair.

    Parameters
    ----------
    sweeps, pairs : numbers of sweeps and pairs in the repaired file
    notes : one line per sweep that lost pairs, and per other loss
    damaged : path of the damaged file; ``None`` if the file was undamaged and is unchanged
    """

    sweeps: int
    pairs: int
    notes: tuple[str, ...]
    damaged: Path | None


@dataclass
class _Found:
    """Undamaged rows of a damaged file.

    ``entries`` by sweep number; ``batches`` by id, each as its sweep number and its location in the file;
    ``history`` by id.
    """

    scene: Scene
    unit: str
    is_sealed: bool
    entries: dict[int, SweepInfo] = field(default_factory=dict)
    batches: dict[int, tuple[int, Place]] = field(default_factory=dict)
    history: dict[int, tuple[str, str, Any]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    @property
    def width(self) -> tuple[int, int]:
        """Number of axes and of strain channels."""
        return self.scene.dimension, self.scene.layout.size


def repair(path: str | Path, scene: Scene | None = None) -> RepairReport:
    """Replace a damaged scan file by a new one with all undamaged rows.

    The damaged file is kept as ``<name>.damaged``. In files of schema version 1, which have no checksums,
    a row counts as undamaged if its shape is valid.

    Parameters
    ----------
    path : the scan file
    scene : scene of the scan, used if the header in the file is damaged

    Raises
    ------
    ScanError
        Nothing in the file can be used, its header is damaged and no scene is given, it is being written by
        another process, or the new file cannot be written.
    """
    path = Path(path)
    if not path.is_file():
        raise ScanError(f"{path}: expected a scan file, found {'a directory' if path.is_dir() else 'none'}")
    lock = ScanLock(path)
    try:
        return _report_if_undamaged(path) or _repair(path, scene)
    except OSError as error:
        raise ScanError(f"{path}: could not repair the file, {error.strerror}") from None
    finally:
        lock.release()


def _report_if_undamaged(path: Path) -> RepairReport | None:
    try:
        with ScanStore.open(path) as store:
            pairs = sum(len(batch) for batch in store.batches(include_dropped=True))
            return RepairReport(len(store.sweeps()), pairs, (), None)
    except ScanError:
        return None


def _repair(path: Path, scene: Scene | None) -> RepairReport:
    damaged = path.with_name(path.name + DAMAGED_SUFFIX)
    if damaged.exists():
        raise ScanError(f"{damaged}: expected no file of this name, found one")
    repaired = path.with_name(f"{path.name}.repaired")
    with Pages(path) as pages:
        found = _search(path, pages, scene)
        with new_scan(repaired, found.scene, strain_unit=found.unit) as store:
            numbers = {sweep for sweep, _ in found.batches.values()}
            entries = [found.entries.get(number, SweepInfo(number)) for number in sorted(numbers)]
            store.copy_sweeps(entries, _batches(pages, found))
            notes = tuple(found.notes)
            history = [found.history[key] for key in sorted(found.history)]
            store.note("repair", {"file": str(damaged), "notes": notes, "history": history})
            report = RepairReport(len(entries), store.pairs, notes, damaged)
    take_place(repaired, path, damaged)
    return report


def _search(path: Path, pages: Pages, scene: Scene | None) -> _Found:
    """Find all undamaged rows, and note the losses.

    Raises
    ------
    ScanError
        No scene is known, or no pairs are undamaged.
    """
    found = _header(path, pages, scene)
    for place, (key, columns) in pages.rows():
        kinds = [type(column) for column in columns]
        if kinds == [type(None), str, str, str]:
            with contextlib.suppress(ValueError, RecursionError):
                found.history[key] = (columns[1], columns[2], json.loads(columns[3]))
        elif len(columns) == (9 if found.is_sealed else 8):
            with contextlib.suppress(ValueError):
                batch = Batch.from_row((key, *columns[1:]), *found.width)
                found.batches[batch.id] = batch.sweep, place
        elif len(columns) == (11 if found.is_sealed else 5):
            with contextlib.suppress(ValueError):
                _keep_entry(found, (key, *columns[1:]))
    if not found.batches:
        raise ScanError(f"{path}: expected undamaged pairs, found none")
    found.notes += _losses(found)
    return found


def _header(path: Path, pages: Pages, scene: Scene | None) -> _Found:
    rows = (columns for _, (_, columns) in pages.rows() if len(columns) == 2)
    header = {key: value for key, value in rows if key in _HEADER_KEYS and isinstance(value, str)}
    # Schema version 1 has no seals. The header's seal may be lost in later versions; then the rows decide.
    is_sealed = bool({"seal", "contents"} & header.keys()) or any(
        len(columns) == 11 for _, (_, columns) in pages.rows()
    )
    try:
        if is_sealed and header.get("seal") != header_seal(header):
            raise ValueError("the checksum does not match")
        own, unit = scene_from_dict(json.loads(header["scene"])), str(json.loads(header["units"])["strain"])
        return _Found(own, unit, is_sealed)
    except (KeyError, TypeError, ValueError, RecursionError, SceneError):
        if scene is None:
            raise ScanError(
                f"{path}: expected an undamaged header, found none; give the scan's scene (--scene)"
            ) from None
        lost = "the header was damaged: used the given scene, and assumed V as the unit of strain"
        return _Found(scene, "V", is_sealed, notes=[lost])


def _keep_entry(found: _Found, row: tuple[Any, ...]) -> None:
    """Keep the entry of a sweep; of several copies, the one written last."""
    if found.is_sealed:
        entry = SweepInfo.from_row(row[:10])
        if row[10] != sweep_seal(entry):
            return
    else:
        entry = SweepInfo.from_row((*row, 0, 0, 0, 0, 0))
    known = found.entries.get(entry.number)
    if known is None or known.revision < entry.revision:
        found.entries[entry.number] = entry


def _losses(found: _Found) -> Iterator[str]:
    """One line per loss."""
    if not found.is_sealed:
        yield "the file had no checksums: damage within its pairs cannot be detected"
        lost = len(set(range(1, max(found.batches) + 1)) - found.batches.keys())
        if lost:
            yield f"lost at least {lost} batches"
    counts: dict[int, int] = dict.fromkeys(found.entries, 0)
    for sweep, _ in found.batches.values():
        counts[sweep] = counts.get(sweep, 0) + 1
    for number, count in sorted(counts.items()):
        entry = found.entries.get(number)
        if entry is None:
            yield f"sweep {number}: lost its entry, which held whether it was dropped; kept {count} batches"
        elif found.is_sealed and count < entry.batches:
            yield f"sweep {number}: lost {entry.batches - count} of {entry.batches} batches"
        elif not found.is_sealed and not count:
            yield f"sweep {number}: lost all batches"


def _batches(pages: Pages, found: _Found) -> Iterator[Batch]:
    """Batches in order of recording, sweep by sweep."""
    first: dict[int, int] = {}
    for key, (sweep, _) in sorted(found.batches.items()):
        first.setdefault(sweep, key)
    places = sorted((first[sweep], key, place) for key, (sweep, place) in found.batches.items())
    for _, key, place in places:
        yield Batch.from_row((key, *pages.row(place)[1][1:]), *found.width)
