"""The scan file: state-measurement pairs that survive whatever happens to the process that records them.

One :class:`ScanStore` writes or reads one SQLite file. Appended pairs are committed at least every
0.25 s of wall time; a process killed at any moment loses no more than that, the file opens again, and
recording goes on as a new sweep.
"""

from __future__ import annotations

import json
import math
import sqlite3
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from tactile_localizer import __version__
from tactile_localizer.core.scan import Scan
from tactile_localizer.errors import ScanError, SceneError
from tactile_localizer.io import scan_file
from tactile_localizer.io.recording import RecordedSweep, Recording, missing_status
from tactile_localizer.io.scan_lock import ScanLock
from tactile_localizer.io.scan_match import require_same_scene
from tactile_localizer.io.scene_file import scene_from_dict
from tactile_localizer.scene import GAUGES, Scene

COMMIT_PERIOD_S = 0.25
"""Longest wall time for which appended pairs may stay uncommitted."""

_BATCH_PAIRS = 8192
_BATCH = "pairs, first_ns, last_ns, stamp_ns, states, strain"
_KEPT = "FROM batch WHERE sweep IN (SELECT number FROM sweep WHERE NOT dropped)"


@dataclass(frozen=True)
class SweepInfo:
    """One sweep of a scan file, as its tables describe it.

    Parameters
    ----------
    number : the sweep's number
    pairs : state-measurement pairs
    first_ns, last_ns : stamps of the first and the last pair, ns; 0 without pairs
    gaps : strain samples that had no pose near enough in time
    skipped : strain samples that were missing, saturated or out of bounds
    ended : false when the recording was cut off
    dropped : true when a person has left the sweep out
    """

    number: int
    pairs: int
    first_ns: int
    last_ns: int
    gaps: int
    skipped: int
    ended: bool
    dropped: bool


class ScanStore:
    """A scan file, open. Use :meth:`create`, :meth:`open`, or :meth:`open_or_create`; close it after use.

    Not safe for several threads at once; threads may take turns.
    """

    def __init__(self, path: Path, connection: sqlite3.Connection, lock: ScanLock | None) -> None:
        self.path = path
        self._db = connection
        self._lock = lock
        self._sweep: int | None = None
        self._pending: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self._pending_pairs = 0
        self._committed_at = time.monotonic()
        try:
            header = scan_file.read_header(connection)
            self.scene: Scene = scene_from_dict(header["scene"])
            self.units: dict[str, str] = header["units"]
            self._pairs = int(self._fetch("SELECT coalesce(sum(pairs), 0) FROM batch")[0][0])
        except (KeyError, ValueError, SceneError, ScanError, sqlite3.Error) as error:
            scan_file.close(connection)
            raise ScanError(f"{path}: expected a scan file, could not read its header: {error}") from None

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
            The file is missing, is not a scan, was made by a newer version, or, when it is to be
            written, is being written by another process.
        """
        path = Path(path)
        if not writable:
            return cls(path, scan_file.open_existing(path, writable=False), None)
        lock = ScanLock(path)
        try:
            return cls(path, scan_file.open_existing(path, writable=True), lock)
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
            scan_file.close(self._db)
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
        return self._pairs + self._pending_pairs

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
        taken = {row[0] for row in self._fetch("SELECT number FROM sweep")}
        if number is None or number in taken:
            number = max(taken, default=0) + 1
        self._write([("INSERT INTO sweep (number) VALUES (?)", (number,))], f"sweep {number}")
        self._sweep = number
        self._committed_at = time.monotonic()
        return number

    def append(self, stamp_ns: np.ndarray, states: np.ndarray, strain: np.ndarray) -> None:
        """Append pairs to the sweep that is being recorded.

        Parameters
        ----------
        stamp_ns : (n,) int64 stamps, ns
        states : (n, d) palm positions, m (yaw: rad), finite
        strain : (n, 8F) strain voltages, V, finite

        Raises
        ------
        ScanError
            No sweep is being recorded, shapes or values are wrong, or the file cannot be written.
        """
        if self._sweep is None:
            raise ScanError(f"{self.path}: expected a sweep under way, found none")
        n = len(stamp_ns)
        shapes = (n, self.scene.dimension), (n, GAUGES * len(self.scene.phalanges))
        if (states.shape, strain.shape) != shapes:
            raise ScanError(f"pairs: expected shapes {shapes}, got {states.shape} and {strain.shape}")
        if not (np.isfinite(states).all() and np.isfinite(strain).all()):
            raise ScanError("pairs: expected finite values, found NaN or infinity")
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
        columns = [np.concatenate(column) for column in zip(*self._pending, strict=True)]
        stamp_ns, states, strain = (
            np.ascontiguousarray(column, dtype=kind)
            for column, kind in zip(columns, ("<i8", "<f8", "<f8"), strict=True)
        )
        rows = []
        for start in range(0, len(stamp_ns), _BATCH_PAIRS):
            part = slice(start, start + _BATCH_PAIRS)
            stamps = stamp_ns[part]
            rows.append(
                (
                    f"INSERT INTO batch (sweep, {_BATCH}) VALUES (?, ?, ?, ?, ?, ?, ?)",
                    (
                        self._sweep,
                        len(stamps),
                        int(stamps.min()),
                        int(stamps.max()),
                        stamps.tobytes(),
                        states[part].tobytes(),
                        strain[part].tobytes(),
                    ),
                )
            )
        self._write(rows, f"{len(stamp_ns)} pairs")
        self._pairs += self._pending_pairs
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
            end = "UPDATE sweep SET ended = 1, gaps = ?, skipped = ? WHERE number = ?"
            self._write([(end, (gaps, skipped, number))], f"end of sweep {number}")
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
        numbers = [row[0] for row in self._fetch("SELECT number FROM sweep ORDER BY number")]
        if number not in numbers:
            raise ScanError(f"{self.path}: expected a sweep of {_ranges(numbers)}, got {number}")
        update = "UPDATE sweep SET dropped = ? WHERE number = ?"
        self._write([(update, (int(dropped), number))], f"sweep {number}")
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
        taken = {sweep.number for sweep in self.sweeps()}
        insert = f"INSERT INTO batch (sweep, {_BATCH}) VALUES (?, ?, ?, ?, ?, ?, ?)"
        for sweep in other.sweeps():
            number = sweep.number if sweep.number not in taken else max(taken) + 1
            taken.add(number)
            row = (number, sweep.ended, sweep.gaps, sweep.skipped, sweep.dropped)
            batches = other._fetch(f"SELECT {_BATCH} FROM batch WHERE sweep = {sweep.number} ORDER BY id")
            begin = ("INSERT INTO sweep VALUES (?, ?, ?, ?, ?)", row)
            self._write([begin, *((insert, (number, *batch)) for batch in batches)], f"sweep {number}")
            self._pairs += sweep.pairs
        self.note("merge", {"file": str(other.path), "history": other.history()})

    def note(self, what: str, detail: dict[str, Any]) -> None:
        """Add an entry to the file's history: where its pairs came from and what was done to them."""
        at = datetime.now(timezone.utc).isoformat(timespec="seconds")
        insert = "INSERT INTO history (at, what, detail) VALUES (?, ?, ?)"
        entry = json.dumps({**detail, "version": __version__})
        self._write([(insert, (at, what, entry))], "history entry")

    # Reading

    def sweeps(self) -> list[SweepInfo]:
        """The sweeps, by number, dropped ones included."""
        rows = self._fetch(
            "SELECT number, coalesce(sum(pairs), 0), coalesce(min(first_ns), 0), coalesce(max(last_ns), 0),"
            " gaps, skipped, ended, dropped FROM sweep LEFT JOIN batch ON batch.sweep = sweep.number"
            " GROUP BY number ORDER BY number"
        )
        return [
            SweepInfo(number, pairs, first_ns, last_ns, gaps, skipped, bool(ended), bool(dropped))
            for number, pairs, first_ns, last_ns, gaps, skipped, ended, dropped in rows
        ]

    def history(self) -> list[tuple[str, str, dict[str, Any]]]:
        """The file's history, oldest first: time (ISO 8601, UTC), what was done, its details."""
        rows = self._fetch("SELECT at, what, detail FROM history ORDER BY id")
        return [(at, what, json.loads(detail)) for at, what, detail in rows]

    def load(self, at_most: int | None = None) -> Scan:
        """The pairs of the sweeps that are not dropped, in the order in which they were recorded.

        Parameters
        ----------
        at_most : of a longer scan, load each second, third, ... pair, so that it is no more pairs than this

        Raises
        ------
        ScanError
            The file is damaged or holds no pairs.
        """
        _, states, strain, sweep = self._arrays(at_most)
        if not len(states):
            raise ScanError(f"{self.path}: expected at least one state-measurement pair, found none")
        return Scan(states, strain, sweep, self.scene.axis_names, self.scene.phalanx_names)

    def batches(self) -> Iterator[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:
        """The same pairs in parts, so that a long scan takes no more memory than a short one.

        Yields
        ------
        sweep : int
            Its number.
        stamp_ns : numpy.ndarray, (n,)
        states : numpy.ndarray, (n, d)
        strain : numpy.ndarray, (n, 8F)

        Raises
        ------
        ScanError
            The file is damaged.
        """
        read = 0
        try:
            query = f"SELECT sweep, pairs, stamp_ns, states, strain {_KEPT} ORDER BY id"
            for sweep, pairs, stamp_ns, states, strain in self._db.execute(query):
                yield (
                    sweep,
                    np.frombuffer(stamp_ns, "<i8").reshape(pairs),
                    np.frombuffer(states, "<f8").reshape(pairs, self.scene.dimension),
                    np.frombuffer(strain, "<f8").reshape(pairs, GAUGES * len(self.scene.phalanges)),
                )
                read += pairs
        except (sqlite3.Error, ValueError) as error:
            n = self._kept_pairs()
            raise ScanError(f"{self.path}: expected {n} pairs, could read {read}: {error}") from None

    def recording(self) -> Recording:
        """The same pairs by sweep and with their stamps, as any other recording.

        Raises
        ------
        ScanError
            The file is damaged.
        """
        stamp_ns, states, strain, sweep = self._arrays()
        infos = {info.number: info for info in self.sweeps()}
        sweeps = []
        for number in np.unique(sweep):
            mine = sweep == number
            sweeps.append(
                RecordedSweep(
                    number=int(number),
                    stamp_ns=stamp_ns[mine],
                    position=states[mine],
                    strain=strain[mine],
                    status=missing_status(strain[mine]),
                    gaps=infos[int(number)].gaps,
                )
            )
        return Recording(str(self.path), self.scene.axis_names, self.scene.phalanx_names, tuple(sweeps))

    def _arrays(self, at_most: int | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        self._fetch("BEGIN")  # what is appended meanwhile is left for the next time
        try:
            return self._arrays_of_now(at_most)
        finally:
            self._fetch("COMMIT")

    def _arrays_of_now(self, at_most: int | None) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        n = self._kept_pairs()
        step = 1 if at_most is None else max(1, math.ceil(n / at_most))
        loaded = math.ceil(n / step)
        stamp_ns = np.empty(loaded, dtype=np.int64)
        states = np.empty((loaded, self.scene.dimension))
        strain = np.empty((loaded, GAUGES * len(self.scene.phalanges)))
        sweep = np.empty(loaded, dtype=np.int64)
        read = 0
        for number, *batch in self.batches():
            pairs = len(batch[0])
            mine = slice(-read % step, None, step)
            rows = slice(math.ceil(read / step), math.ceil((read + pairs) / step))
            sweep[rows] = number
            stamp_ns[rows], states[rows], strain[rows] = (part[mine] for part in batch)
            read += pairs
        return stamp_ns, states, strain, sweep

    def _kept_pairs(self) -> int:
        return int(self._fetch(f"SELECT coalesce(sum(pairs), 0) {_KEPT}")[0][0])

    def _fetch(self, query: str) -> list[tuple[Any, ...]]:
        try:
            return self._db.execute(query).fetchall()
        except sqlite3.Error as error:
            raise ScanError(f"{self.path}: expected a scan file that can be read, {error}") from None

    def _write(self, statements: list[tuple[str, tuple[Any, ...]]], what: str) -> None:
        if self._lock is None:
            raise ScanError(f"{self.path}: expected to be open for writing, it is open for reading")
        try:
            self._db.execute("BEGIN IMMEDIATE")
            for statement, values in statements:
                self._db.execute(statement, values)
            self._db.execute("COMMIT")
        except sqlite3.Error as error:
            if self._db.in_transaction:
                self._db.execute("ROLLBACK")
            raise ScanError(f"{self.path}: could not write {what}: {error}") from None


def _ranges(numbers: list[int]) -> str:
    return f"{numbers[0]} to {numbers[-1]}" if numbers else "none"
