"""Crash-safe storage of state-measurement pairs in a scan file.

One :class:`ScanStore` writes or reads one SQLite file. Appended pairs are committed at least every
0.25 s of wall time, so a process killed at any moment loses no more than that. The file opens again
afterwards, and recording continues with a new sweep.
"""

from __future__ import annotations

import itertools
import json
import sqlite3
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any

import numpy as np

from tactile_localizer import __version__
from tactile_localizer.errors import ScanError
from tactile_localizer.io.scans import file as scan_file
from tactile_localizer.io.scans.lock import ScanLock
from tactile_localizer.io.scans.reader import ScanReader
from tactile_localizer.io.scans.rows import (
    BATCH_COLUMNS,
    Batch,
    LearnedEntry,
    SweepInfo,
    contents_seal,
    require_plausible,
    sweep_seal,
)
from tactile_localizer.scene import Scene

COMMIT_PERIOD_S = 0.25
"""Longest wall time for which appended pairs stay uncommitted, s."""

_BATCH_PAIRS = 8192
"""Most pairs in one row of the table ``batch``: about 1.2 MB with two phalanges of 8 channels."""

Statement = tuple[str, tuple[Any, ...]]
"""An SQL statement and the values of its placeholders."""


class ScanStore(ScanReader):
    """An open scan file, made by :meth:`create`, :meth:`open` or :meth:`open_or_create`.

    Close it after use. Calls from several threads must not overlap.
    """

    def __init__(self, path: Path, connection: sqlite3.Connection, lock: ScanLock | None) -> None:
        super().__init__(path, connection)
        self._lock = lock
        self._sweep: int | None = None
        self._pending: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self._pending_pairs = 0
        self._committed_at = time.monotonic()
        try:
            self._entries = {info.number: info for info in self.sweeps()}
            self._next_batch = self._fetch("SELECT coalesce(max(id), 0) + 1 FROM batch")[0][0]
        except ScanError:
            scan_file.close(connection)
            raise

    @classmethod
    def create(cls, path: str | Path, scene: Scene, *, strain_unit: str = "V") -> ScanStore:
        """Create a scan file and open it for writing.

        Parameters
        ----------
        path : must not exist yet
        scene : axes, phalanges and feature of the scan; stored in the file
        strain_unit : unit of the strain values, for display

        Raises
        ------
        ScanError
            The file exists, cannot be written, or is being written by another process.
        """
        path = Path(path)
        lock = ScanLock(path)
        try:
            return cls(path, scan_file.create(path, scene, strain_unit), lock)
        except BaseException:
            lock.release()
            raise

    @classmethod
    def open(cls, path: str | Path, *, writable: bool = False) -> ScanStore:
        """Open a scan file.

        Raises
        ------
        ScanError
            The file is missing, is not a scan, is damaged, was written by a newer version, or, with
            ``writable``, is being written by another process.

        Notes
        -----
        A file of schema version 1, which has no checksums, is read as it is. Opening it for writing
        replaces it by a file of the current version, and keeps the original as ``<name>.schema1``.
        """
        path = Path(path)
        if not writable:
            return cls(path, scan_file.open_existing(path, writable=False), None)
        lock = ScanLock(path)
        try:
            _migrate(path)
            return cls(path, scan_file.open_existing(path, writable=True), lock)
        except BaseException:
            lock.release()
            raise

    @classmethod
    def open_or_create(cls, path: str | Path, scene: Scene) -> ScanStore:
        """Open a scan file for writing, creating it if there is none.

        Raises
        ------
        ScanError
            As :meth:`open`; or the file holds a scan with different axes, bounds or phalanges.
        """
        path = Path(path)
        if not path.exists() or path.stat().st_size == 0:
            return cls.create(path, scene)
        store = cls.open(path, writable=True)
        try:
            require_same_scene(store.scene, scene, str(path))
        except ScanError:
            store.close()
            raise
        return store

    def __enter__(self) -> ScanStore:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Commit pending pairs, end the sweep, close the file and release the write lock.

        Raises
        ------
        ScanError
            The last pairs could not be written; the file is closed nevertheless.
        """
        try:
            if self._sweep is not None:
                self.end_sweep()
        finally:
            super().close()
            if self._lock is not None:
                self._lock.release()
                self._lock = None

    # Writing

    @property
    def active_sweep(self) -> int | None:
        """Number of the sweep being recorded; ``None`` if there is none."""
        return self._sweep

    @property
    def pairs(self) -> int:
        """Number of pairs, including dropped sweeps and pairs not yet committed."""
        return sum(entry.pairs for entry in self._entries.values()) + self._pending_pairs

    def begin_sweep(self, number: int | None = None) -> int:
        """Begin recording a sweep.

        Parameters
        ----------
        number : its number; by default, or if the number is in use, one more than the highest

        Returns
        -------
        int
            The sweep's number.

        Raises
        ------
        ScanError
            A sweep is already being recorded, or the file cannot be written.
        """
        if self._sweep is not None:
            raise ScanError(f"{self.path}: expected no active sweep, found sweep {self._sweep}")
        if number is None or number in self._entries:
            number = max(self._entries, default=0) + 1
        self._write([], f"sweep {number}", SweepInfo(number))
        self._sweep = number
        self._committed_at = time.monotonic()
        return number

    def append(self, stamp_ns: np.ndarray, states: np.ndarray, strain: np.ndarray) -> None:
        """Append pairs to the active sweep.

        Parameters
        ----------
        stamp_ns : (n,) int64 stamps, ns
        states : (n, d) palm positions, m (yaw: rad), finite
        strain : (n, C) strain voltages, V, finite

        Raises
        ------
        ScanError
            There is no active sweep, shapes or values are invalid, or the file cannot be written.
        """
        if self._sweep is None:
            raise ScanError(f"{self.path}: expected an active sweep, found none")
        n = len(stamp_ns)
        shapes = (n, self.scene.dimension), (n, self._channels)
        if (states.shape, strain.shape) != shapes:
            raise ScanError(f"pairs: expected shapes {shapes}, got {states.shape} and {strain.shape}")
        try:
            require_plausible(states, strain)
        except ValueError as error:
            raise ScanError(f"pairs: {error}") from None
        self._pending.append((stamp_ns, states, strain))
        self._pending_pairs += n
        due = time.monotonic() - self._committed_at >= COMMIT_PERIOD_S
        if due or self._pending_pairs >= _BATCH_PAIRS:
            self.commit()

    def commit(self) -> None:
        """Write the pending pairs in one transaction. Recorders also call this on a timer.

        Raises
        ------
        ScanError
            The file cannot be written; the pairs stay pending.
        """
        self._committed_at = time.monotonic()
        if not self._pending:
            return
        assert self._sweep is not None
        columns = [np.concatenate(column) for column in zip(*self._pending, strict=True)]
        pairs = len(columns[0])
        batches: list[Batch] = []
        for start in range(0, pairs, _BATCH_PAIRS):
            part = slice(start, start + _BATCH_PAIRS)
            number = self._next_batch + len(batches)
            batches.append(Batch(number, self._sweep, *(column[part] for column in columns)))
        self._write_batches(batches, f"{pairs} pairs")
        self._pending, self._pending_pairs = [], 0

    def end_sweep(self, *, gaps: int = 0, skipped: int = 0) -> None:
        """Commit and end the active sweep.

        Parameters
        ----------
        gaps : strain samples without a pose close enough in time
        skipped : strain samples that were missing, saturated or out of bounds

        Raises
        ------
        ScanError
            The file cannot be written. The sweep ends nevertheless: pending pairs are lost, committed
            pairs are kept, and another sweep can begin.
        """
        number, self._sweep = self._sweep, None
        if number is None:
            raise ScanError(f"{self.path}: expected an active sweep, found none")
        try:
            self._sweep = number
            self.commit()
            ended = replace(self._entries[number], ended=True, gaps=gaps, skipped=skipped)
            self._write([], f"end of sweep {number}", ended)
        finally:
            self._sweep = None
            self._pending, self._pending_pairs = [], 0

    def drop_sweep(self, number: int, *, dropped: bool = True) -> None:
        """Exclude a sweep from :meth:`load`, or include it again. Its pairs stay in the file.

        Raises
        ------
        ScanError
            There is no such sweep, or the file cannot be written.
        """
        if number not in self._entries:
            known = f"{min(self._entries)} to {max(self._entries)}" if self._entries else "none"
            raise ScanError(f"{self.path}: expected a sweep of {known}, got {number}")
        self._write([], f"sweep {number}", replace(self._entries[number], dropped=dropped))
        self.note("drop sweep" if dropped else "restore sweep", {"sweep": number})

    def merge(self, other: ScanStore) -> None:
        """Copy all sweeps of another file, including dropped ones.

        A sweep whose number is in use gets the next free number.

        Raises
        ------
        ScanError
            The other file has a different scene or unit, or one of the files cannot be read or written.
        """
        require_same_scene(other.scene, self.scene, str(other.path))
        if other.units != self.units:
            raise ScanError(
                f"{other.path}: expected strain in {self.units['strain']}, found {other.units['strain']}"
            )
        self.copy_sweeps(other.sweeps(), other.batches(include_dropped=True))
        self.note("merge", {"file": str(other.path), "history": other.history()})

    def copy_sweeps(self, sweeps: Iterable[SweepInfo], batches: Iterable[Batch]) -> None:
        """Write the sweeps of another file; a sweep whose number is in use gets the next free number.

        Parameters
        ----------
        sweeps : entries of the sweeps
        batches : pairs of the sweeps, consecutive for each sweep

        Raises
        ------
        ScanError
            The file cannot be written, or iterating over ``batches`` fails.
        """
        renumbered: dict[int, int] = {}
        for info in sweeps:
            number = info.number if info.number not in self._entries else max(self._entries) + 1
            renumbered[info.number] = number
            self._write([], f"sweep {number}", replace(info, number=number, pairs=0, batches=0, revision=0))
        for sweep, group in itertools.groupby(batches, lambda batch: batch.sweep):
            number = renumbered[sweep]
            copies = [replace(batch, id=self._next_batch + i, sweep=number) for i, batch in enumerate(group)]
            self._write_batches(copies, f"pairs of sweep {number}")

    def note(self, what: str, detail: dict[str, Any], at: str | None = None) -> None:
        """Add an entry to the file's history, which records the origin of the pairs and every change.

        ``at`` is the time (ISO 8601, UTC), by default now.
        """
        at = at or datetime.now(timezone.utc).isoformat(timespec="seconds")
        insert = "INSERT INTO history (at, what, detail) VALUES (?, ?, ?)"
        entry = json.dumps({"version": __version__, **detail})
        self._write([(insert, (at, what, entry))], "history entry")

    def store_learned(self, entry: LearnedEntry) -> None:
        """Store a result computed from the scan, replacing an earlier one under the same key.

        Raises
        ------
        ScanError
            The file cannot be written.
        """
        insert = "INSERT OR REPLACE INTO learned VALUES (?, ?, ?, ?)"
        self._write([(scan_file.LEARNED_TABLE, ()), (insert, entry.row)], entry.key)

    def _write_batches(self, batches: list[Batch], what: str) -> None:
        """Write consecutive batches of one sweep."""
        entry = self._entries[batches[0].sweep]
        insert = f"INSERT INTO batch ({BATCH_COLUMNS}) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)"
        rows = [batch.row for batch in batches]
        stored = [(entry.first_ns, entry.last_ns)] if entry.batches else []
        spans = [*stored, *((first_ns, last_ns) for _, _, _, first_ns, last_ns, *_ in rows)]
        updated = replace(
            entry,
            batches=entry.batches + len(batches),
            pairs=entry.pairs + sum(map(len, batches)),
            first_ns=min(first_ns for first_ns, _ in spans),
            last_ns=max(last_ns for _, last_ns in spans),
        )
        self._write([(insert, row) for row in rows], what, updated)
        self._next_batch += len(batches)

    def _write(self, statements: list[Statement], what: str, entry: SweepInfo | None = None) -> None:
        """Write in one transaction, together with the ``entry`` of the modified sweep."""
        if self._lock is None:
            raise ScanError(f"{self.path}: expected a scan file opened for writing, it is opened for reading")
        entries = self._entries
        if entry is not None:
            entry = replace(entry, revision=entry.revision + 1)
            entries = {**entries, entry.number: entry}
            seals = [sweep_seal(entries[number]) for number in sorted(entries)]
            placeholders = ", ".join("?" * (len(entry.row) + 1))
            statements = [
                (f"INSERT OR REPLACE INTO sweep VALUES ({placeholders})", (*entry.row, sweep_seal(entry))),
                *statements,
                ("UPDATE header SET value = ? WHERE key = 'contents'", (contents_seal(seals),)),
            ]
        try:
            self._db.execute("BEGIN IMMEDIATE")
            for statement, values in statements:
                self._db.execute(statement, values)
            self._db.execute("COMMIT")
        except scan_file.SQLITE_ERRORS as error:
            if self._db.in_transaction:
                self._db.execute("ROLLBACK")
            raise ScanError(f"{self.path}: could not write {what}: {error}") from None
        self._entries = entries


def require_same_scene(found: Scene, expected: Scene, where: str) -> None:
    """Require that pairs of both scenes can share one file: same axes, bounds, phalanges and name.

    Raises
    ------
    ScanError
        The scenes differ; the message names the difference.
    """
    values: dict[str, Callable[[Scene], Iterable[object]]] = {
        "axes": lambda scene: scene.axis_names,
        "lower bounds": lambda scene: scene.lower,
        "upper bounds": lambda scene: scene.upper,
        "phalanges": lambda scene: scene.phalanx_names,
        "channels": lambda scene: scene.layout.counts,
        "phalanx offsets": lambda scene: [phalanx.offset for phalanx in scene.phalanges],
        "name": lambda scene: [scene.name],
    }
    for what, of in values.items():
        texts = [", ".join(map(str, of(each))) for each in (expected, found)]
        if list(of(expected)) != list(of(found)):
            raise ScanError(f"{where}: expected {what} {texts[0]}, found {texts[1]}")


@contextmanager
def new_scan(path: str | Path, scene: Scene, *, strain_unit: str = "V") -> Iterator[ScanStore]:
    """Context that creates a scan file under a temporary name and renames it to ``path`` on success.

    If the block raises, no file is left behind.

    Parameters
    ----------
    path : must not exist yet; missing parent folders are created
    scene : stored in the file
    strain_unit : unit of the strain values, for display

    Raises
    ------
    ScanError
        The file exists, or could not be written completely.
    """
    path = Path(path)
    if path.exists():
        raise ScanError(f"{path}: expected no file of this name, found one; choose another or remove it")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        folder = TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent)
    except OSError as error:
        raise ScanError(f"{path}: expected a writable folder, {error.strerror}") from None
    with folder:
        unfinished = Path(folder.name, path.name)
        with ScanStore.create(unfinished, scene, strain_unit=strain_unit) as store:
            yield store
        # On a full disk SQLite leaves in its write-ahead log what did not fit into the file.
        if Path(f"{unfinished}-wal").exists():
            raise ScanError(f"{path}: expected enough disk space, only part of the scan could be written")
        unfinished.rename(path)


def take_place(renewed: Path, path: Path, kept: Path) -> None:
    """Move a new file to the ``path`` of a scan file, which is kept as ``kept``.

    Raises
    ------
    OSError
        A file cannot be renamed.
    """
    with suppress(OSError):  # on file systems with links there is a file under that name at every moment
        kept.hardlink_to(path)
    # Processes that still read the old file need its log and shared memory under matching names.
    for suffix in ("-wal", "-shm"):
        with suppress(FileNotFoundError):
            Path(f"{path}{suffix}").rename(f"{kept}{suffix}")
    if not kept.exists():
        path.rename(kept)
    renewed.replace(path)


def _migrate(path: Path) -> None:
    """Replace a file of schema version 1, if it is undamaged, by one with checksums."""
    renewed, kept = (path.with_name(f"{path.name}{suffix}") for suffix in (".migrated", ".schema1"))
    with ScanStore.open(path) as old:
        if old.has_checksums:
            return
        if kept.exists():
            raise ScanError(f"{kept}: expected no file of this name, found one")
        with new_scan(renewed, old.scene, strain_unit=old.units["strain"]) as store:
            store.copy_sweeps(old.sweeps(), old.batches(include_dropped=True))
            for at, what, detail in old.history():
                store.note(what, detail, at)
    try:
        take_place(renewed, path, kept)
    except OSError as error:
        raise ScanError(f"{path}: could not keep the original as {kept}, {error.strerror}") from None
