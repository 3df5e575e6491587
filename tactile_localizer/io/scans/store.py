"""The scan file: state-measurement pairs that survive whatever happens to the process that records them.

One :class:`ScanStore` writes or reads one SQLite file. Appended pairs are committed at least every
0.25 s of wall time; a process killed at any moment loses no more than that, the file opens again, and
recording goes on as a new sweep.
"""

from __future__ import annotations

import itertools
import json
import sqlite3
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
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
from tactile_localizer.io.scans.batch import COLUMNS, Batch, require_possible
from tactile_localizer.io.scans.lock import ScanLock
from tactile_localizer.io.scans.migration import migrate
from tactile_localizer.io.scans.reader import ScanReader
from tactile_localizer.io.scans.seals import contents_seal, sweep_seal
from tactile_localizer.io.scans.sweep_info import SweepInfo
from tactile_localizer.scene import Scene

COMMIT_PERIOD_S = 0.25
"""Longest wall time for which appended pairs may stay uncommitted."""

_BATCH_PAIRS = 8192

Statement = tuple[str, tuple[Any, ...]]


class ScanStore(ScanReader):
    """A scan file, open. Use :meth:`create`, :meth:`open`, or :meth:`open_or_create`; close it after use.

    Not safe for several threads at once; threads may take turns.
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
        """Make a new scan file and open it for writing.

        Parameters
        ----------
        path : must not exist yet
        scene : what is modelled; kept inside the file
        strain_unit : what the strain values are, for people

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
            The file is missing, is not a scan, is damaged, was made by a newer version, or, when it is
            to be written, is being written by another process.

        Notes
        -----
        A file of schema version 1, which has no checksums, is read as it is; it is migrated when it is
        opened for writing, and a copy of it is kept (:mod:`~tactile_localizer.io.scans.migration`).
        """
        path = Path(path)
        if not writable:
            return cls(path, scan_file.open_existing(path, writable=False), None)
        lock = ScanLock(path)
        try:
            connection = scan_file.open_existing(path, writable=True)
            migrate(path, connection)
            return cls(path, connection, lock)
        except BaseException:
            lock.release()
            raise

    @classmethod
    def open_or_create(cls, path: str | Path, scene: Scene) -> ScanStore:
        """Open a scan file for writing, making it if there is none.

        Raises
        ------
        ScanError
            As :meth:`open`; or the file holds a scan of other axes, bounds or phalanges.
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
        """Commit what is pending, end the sweep, close the file and let another writer in.

        Raises
        ------
        ScanError
            The last pairs could not be written; the file is closed all the same.
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
        """Number of the sweep that is being recorded, if one is."""
        return self._sweep

    @property
    def pairs(self) -> int:
        """Pairs in the file, dropped sweeps and pending pairs included."""
        return sum(entry.pairs for entry in self._entries.values()) + self._pending_pairs

    def begin_sweep(self, number: int | None = None) -> int:
        """Begin to record a sweep.

        Parameters
        ----------
        number : its number; by default, or where the number is taken, one more than the highest

        Returns
        -------
        int
            The sweep's number.

        Raises
        ------
        ScanError
            A sweep is being recorded already, or the file cannot be written.
        """
        if self._sweep is not None:
            raise ScanError(f"{self.path}: expected no sweep under way, found sweep {self._sweep}")
        if number is None or number in self._entries:
            number = max(self._entries, default=0) + 1
        self._write([], f"sweep {number}", SweepInfo(number))
        self._sweep = number
        self._committed_at = time.monotonic()
        return number

    def append(self, stamp_ns: np.ndarray, states: np.ndarray, strain: np.ndarray) -> None:
        """Append pairs to the sweep that is being recorded.

        Parameters
        ----------
        stamp_ns : (n,) int64 stamps, ns
        states : (n, d) palm positions, m (yaw: rad), finite
        strain : (n, C) strain voltages, V, finite

        Raises
        ------
        ScanError
            No sweep is being recorded, shapes or values are wrong, or the file cannot be written.
        """
        if self._sweep is None:
            raise ScanError(f"{self.path}: expected a sweep under way, found none")
        n = len(stamp_ns)
        shapes = (n, self.scene.dimension), (n, self._channels)
        if (states.shape, strain.shape) != shapes:
            raise ScanError(f"pairs: expected shapes {shapes}, got {states.shape} and {strain.shape}")
        try:
            require_possible(states, strain)
        except ValueError as error:
            raise ScanError(f"pairs: {error}") from None
        self._pending.append((stamp_ns, states, strain))
        self._pending_pairs += n
        due = time.monotonic() - self._committed_at >= COMMIT_PERIOD_S
        if due or self._pending_pairs >= _BATCH_PAIRS:
            self.commit()

    def commit(self) -> None:
        """Write the pending pairs in one transaction. A recorder calls this on a timer as well.

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
        """Commit and end the sweep that is being recorded.

        Parameters
        ----------
        gaps : strain samples that had no pose near enough in time
        skipped : strain samples that were missing, saturated or out of bounds

        Raises
        ------
        ScanError
            The file cannot be written. The sweep counts as ended all the same: what was pending is
            lost, what was committed is not, and another sweep can begin.
        """
        number, self._sweep = self._sweep, None
        if number is None:
            raise ScanError(f"{self.path}: expected a sweep under way, found none")
        try:
            self._sweep = number
            self.commit()
            ended = replace(self._entries[number], ended=True, gaps=gaps, skipped=skipped)
            self._write([], f"end of sweep {number}", ended)
        finally:
            self._sweep = None
            self._pending, self._pending_pairs = [], 0

    def drop_sweep(self, number: int, *, dropped: bool = True) -> None:
        """Leave a sweep out of :meth:`load`, or take it back in. Its pairs stay in the file.

        Raises
        ------
        ScanError
            There is no such sweep, or the file cannot be written.
        """
        if number not in self._entries:
            raise ScanError(
                f"{self.path}: expected a sweep of {_ranges(sorted(self._entries))}, got {number}"
            )
        self._write([], f"sweep {number}", replace(self._entries[number], dropped=dropped))
        self.note("drop sweep" if dropped else "take sweep back", {"sweep": number})

    def absorb(self, other: ScanStore) -> None:
        """Take over another file's sweeps, dropped ones too; a taken number gets the next that is free.

        Raises
        ------
        ScanError
            The other file is of another scene or unit, or one of the files fails.
        """
        require_same_scene(other.scene, self.scene, str(other.path))
        if other.units != self.units:
            raise ScanError(
                f"{other.path}: expected strain in {self.units['strain']}, found {other.units['strain']}"
            )
        self.take_over(other.sweeps(), other.checked_batches(of_dropped=True))
        self.note("merge", {"file": str(other.path), "history": other.history()})

    def take_over(self, sweeps: Iterable[SweepInfo], batches: Iterable[Batch]) -> None:
        """Write the sweeps of another file; a number that is taken gets the next that is free.

        Parameters
        ----------
        sweeps : their entries
        batches : their pairs, those of a sweep one after the other

        Raises
        ------
        ScanError
            The file cannot be written, or ``batches`` fails.
        """
        renumbered: dict[int, int] = {}
        for info in sweeps:
            number = info.number if info.number not in self._entries else max(self._entries) + 1
            renumbered[info.number] = number
            self._write([], f"sweep {number}", replace(info, number=number, pairs=0, batches=0, revision=0))
        for sweep, group in itertools.groupby(batches, lambda batch: batch.sweep):
            number = renumbered[sweep]
            taken = [replace(batch, id=self._next_batch + i, sweep=number) for i, batch in enumerate(group)]
            self._write_batches(taken, f"pairs of sweep {number}")

    def note(self, what: str, detail: dict[str, Any]) -> None:
        """Add an entry to the file's history: where its pairs came from and what was done to them."""
        at = datetime.now(timezone.utc).isoformat(timespec="seconds")
        insert = "INSERT INTO history (at, what, detail) VALUES (?, ?, ?)"
        entry = json.dumps({**detail, "version": __version__})
        self._write([(insert, (at, what, entry))], "history entry")

    def _write_batches(self, batches: list[Batch], what: str) -> None:
        """Write consecutive batches of one sweep."""
        entry = self._entries[batches[0].sweep]
        insert = f"INSERT INTO batch ({COLUMNS}) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)"
        rows = [batch.row for batch in batches]
        known = [(entry.first_ns, entry.last_ns)] if entry.batches else []
        ends = [*known, *((first_ns, last_ns) for _, _, _, first_ns, last_ns, *_ in rows)]
        changed = replace(
            entry,
            batches=entry.batches + len(batches),
            pairs=entry.pairs + sum(map(len, batches)),
            first_ns=min(first_ns for first_ns, _ in ends),
            last_ns=max(last_ns for _, last_ns in ends),
        )
        self._write([(insert, row) for row in rows], what, changed)
        self._next_batch += len(batches)

    def _write(self, statements: list[Statement], what: str, entry: SweepInfo | None = None) -> None:
        """Write in one transaction, together with the ``entry`` of the sweep that it changes."""
        if self._lock is None:
            raise ScanError(f"{self.path}: expected to be open for writing, it is open for reading")
        entries = self._entries
        if entry is not None:
            entry = replace(entry, revision=entry.revision + 1)
            entries = {**entries, entry.number: entry}
            seals = [sweep_seal(entries[number]) for number in sorted(entries)]
            marks = ", ".join("?" * (len(entry.row) + 1))
            statements = [
                (f"INSERT OR REPLACE INTO sweep VALUES ({marks})", (*entry.row, sweep_seal(entry))),
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


def _ranges(numbers: list[int]) -> str:
    return f"{numbers[0]} to {numbers[-1]}" if numbers else "none"


def require_same_scene(found: Scene, expected: Scene, where: str) -> None:
    """Check that pairs of both scenes can lie in one file: the same axes, bounds, phalanges and name.

    Raises
    ------
    ScanError
        They cannot; says what differs.
    """
    for what, mine, theirs in (
        ("axes", found.axis_names, expected.axis_names),
        ("lower bounds", tuple(found.lower), tuple(expected.lower)),
        ("upper bounds", tuple(found.upper), tuple(expected.upper)),
        ("phalanges", found.phalanx_names, expected.phalanx_names),
        ("channels", found.layout.counts, expected.layout.counts),
        ("phalanx offsets", _offsets(found), _offsets(expected)),
        ("name", (found.name,), (expected.name,)),
    ):
        if mine != theirs:
            raise ScanError(f"{where}: expected {what} {_text(theirs)}, found {_text(mine)}")


def _offsets(scene: Scene) -> tuple[tuple[float, ...], ...]:
    return tuple(phalanx.offset for phalanx in scene.phalanges)


def _text(values: tuple[Any, ...]) -> str:
    return ", ".join(value if isinstance(value, str) else f"{value}" for value in values)


@contextmanager
def new_scan(path: str | Path, scene: Scene, *, strain_unit: str = "V") -> Iterator[ScanStore]:
    """A scan file to be filled: it becomes ``path`` when the block ends well, and is gone when it fails.

    Parameters
    ----------
    path : must not exist yet; its folder is made where there is none
    scene : kept in the file
    strain_unit : what the strain values are, for people

    Raises
    ------
    ScanError
        The file exists, or not all of it could be written.
    """
    path = Path(path)
    if path.exists():
        raise ScanError(f"{path}: expected no file of this name yet, found one; name another, or remove it")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        folder = TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent)
    except OSError as error:
        raise ScanError(f"{path}: expected a folder that can be written, {error.strerror}") from None
    with folder:
        unfinished = Path(folder.name, path.name)
        with ScanStore.create(unfinished, scene, strain_unit=strain_unit) as store:
            yield store
        # On a full disk SQLite keeps in its log what it could not put into the file.
        if Path(f"{unfinished}-wal").exists():
            raise ScanError(f"{path}: expected room for all of the scan, could write a part")
        unfinished.rename(path)
