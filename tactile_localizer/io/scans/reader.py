"""Reading a scan file: its sweeps, pairs and history, with the checksum of every row verified."""

from __future__ import annotations

import contextlib
import json
import math
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ScanError, SceneError
from tactile_localizer.io.recording import RecordedSweep, Recording, missing_status
from tactile_localizer.io.scans import file as scan_file
from tactile_localizer.io.scans.rows import (
    BATCH_COLUMNS,
    UNSEALED_BATCH_COLUMNS,
    Batch,
    LearnedEntry,
    SweepInfo,
    contents_seal,
    sweep_seal,
)
from tactile_localizer.io.scene_file import scene_from_dict
from tactile_localizer.scene import Scene

Progress = Callable[[float], None]

_MAX_NAMED_SWEEPS = 8
"""Most damaged sweeps named in a message."""

_SWEEPS_OF_SCHEMA_1 = (
    "SELECT number, ended, gaps, skipped, dropped, count(batch.id), coalesce(sum(pairs), 0),"
    " coalesce(min(first_ns), 0), coalesce(max(last_ns), 0), 0"
    " FROM sweep LEFT JOIN batch ON batch.sweep = sweep.number GROUP BY number ORDER BY number"
)


class ScanReader:
    """A scan file that is open for reading.

    Parameters
    ----------
    path : the file's path, for error messages
    connection : connection to the file, from :mod:`~tactile_localizer.io.scans.file`; closed on failure

    Attributes
    ----------
    scene : scene that the scan was recorded for
    units : units of stamps, states and strain, for display

    Raises
    ------
    ScanError
        The header is damaged.
    """

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._db = connection
        try:
            self._schema = scan_file.schema_of(connection)
            header = scan_file.read_header(connection)
            self.scene: Scene = scene_from_dict(header["scene"])
            self.units: dict[str, str] = {str(key): str(unit) for key, unit in header["units"].items()}
            self.units["strain"]
        except (
            KeyError,
            AttributeError,
            TypeError,
            ValueError,
            RecursionError,
            SceneError,
            ScanError,
            *scan_file.SQLITE_ERRORS,
        ) as error:
            scan_file.close(connection)
            raise ScanError(f"{path}: expected a scan file, could not read its header: {error}") from None

    @property
    def has_checksums(self) -> bool:
        """Whether the file has checksums that detect damage (schema version 2 and later)."""
        return self._schema > 1

    def close(self) -> None:
        """Close the file."""
        scan_file.close(self._db)

    def sweeps(self) -> list[SweepInfo]:
        """Entries of all sweeps in the order of their numbers, including dropped sweeps.

        Raises
        ------
        ScanError
            An entry is damaged or lost.
        """
        sealed = self.has_checksums
        query = f"SELECT {SweepInfo.COLUMNS}, seal FROM sweep ORDER BY number"
        sweeps, seals = [], []
        for row in self._fetch(query if sealed else _SWEEPS_OF_SCHEMA_1):
            try:
                sweeps.append(SweepInfo.from_row(row[:10]))
                if sealed and row[10] != sweep_seal(sweeps[-1]):
                    raise ValueError("the checksum does not match")
            except ValueError as error:
                what = f"the entry of sweep {row[0]!r:.20} is damaged, {error}"
                raise ScanError(f"{self.path}: {what}; {scan_file.REPAIR_HINT}") from None
            seals.append(row[10] if sealed else b"")
        if sealed:
            contents = self._fetch("SELECT value FROM header WHERE key = 'contents'")
            if contents != [(contents_seal(seals),)]:
                raise ScanError(
                    f"{self.path}: an entry of a sweep is lost, found {len(sweeps)}; {scan_file.REPAIR_HINT}"
                )
        return sweeps

    def history(self) -> list[tuple[str, str, dict[str, Any]]]:
        """The file's history, oldest first: time (ISO 8601, UTC), action, details."""
        entries = []
        for at, what, text in self._fetch("SELECT at, what, detail FROM history ORDER BY id"):
            try:
                detail = json.loads(text)
            except (TypeError, ValueError, RecursionError):
                detail = None
            if not isinstance(detail, dict):
                detail = {"details": "damaged"}
            entries.append((str(at), str(what), detail))
        return entries

    def learned(self, key: str, digest: str) -> bytes | None:
        """Stored result of that key; ``None`` if it is missing, damaged or computed from other data.

        Parameters
        ----------
        key : name of the result, its algorithm and version
        digest : digest of the data, from :func:`~tactile_localizer.core.scan.digest.digest_of`
        """
        query = "SELECT payload, seal FROM learned WHERE key = ? AND digest = ?"
        try:
            row = self._db.execute(query, (key, digest)).fetchone()
        except scan_file.SQLITE_ERRORS:  # no such table yet, or damage
            return None
        is_intact = row is not None and row == LearnedEntry(key, digest, row[0]).row[2:]
        return bytes(row[0]) if is_intact else None

    def load(self, at_most: int | None = None, progress: Progress | None = None) -> Scan:
        """Pairs of the sweeps that are not dropped, in order of recording.

        Parameters
        ----------
        at_most : maximum number of pairs; of a longer scan every second, third, ... pair is loaded
        progress : called with the loaded fraction, 0 to 1

        Raises
        ------
        ScanError
            A sweep is damaged (the message names it), or the file holds no pairs.
        """
        _, states, strain, sweep = self._arrays(at_most, progress)
        if not len(states):
            raise ScanError(f"{self.path}: expected at least one state-measurement pair, found none")
        scene = self.scene
        return Scan(states, strain, sweep, scene.axis_names, scene.phalanx_names, scene.layout.counts)

    def batches(self, *, include_dropped: bool = False) -> Iterator[Batch]:
        """The pairs batch by batch, in order of recording; memory use does not depend on the scan's length.

        Parameters
        ----------
        include_dropped : whether to include the batches of dropped sweeps

        Raises
        ------
        ScanError
            A sweep is damaged; the message names it.
        """
        with self._snapshot():
            sweeps = {info.number: info for info in self.sweeps()}
            wanted = {number for number, info in sweeps.items() if include_dropped or not info.dropped}
            found = dict.fromkeys(wanted, 0)
            last, reason = -1, None
            try:
                for row in self._db.execute(f"SELECT {self._columns} FROM batch ORDER BY id"):
                    if row[1] not in sweeps:
                        raise ValueError(f"expected a batch of a known sweep, found sweep {row[1]!r:.20}")
                    if row[1] in wanted:
                        batch = self._batch(row)
                        if batch.id <= last:  # SQLite does not verify the order of pages in its tree
                            raise ValueError(f"expected batches in order, found {batch.id} after {last}")
                        last = batch.id
                        found[batch.sweep] += 1
                        yield batch
            except (*scan_file.SQLITE_ERRORS, ValueError) as error:
                reason = scan_file.one_line(error)
            lost = {number: sweeps[number].batches - found[number] for number in wanted}
            if reason is not None or any(lost.values()):
                damage = " ".join(filter(None, (self._damage(sweeps, wanted), reason and f"({reason})")))
                raise ScanError(f"{self.path}: {damage}; {scan_file.REPAIR_HINT}")

    def recording(self) -> Recording:
        """The same pairs as a recording, by sweep and with their stamps.

        Raises
        ------
        ScanError
            A sweep is damaged; the message names it.
        """
        stamp_ns, states, strain, sweep = self._arrays()
        infos = {info.number: info for info in self.sweeps()}
        sweeps = []
        for number in np.unique(sweep):
            rows = sweep == number
            sweeps.append(
                RecordedSweep(
                    number=int(number),
                    stamp_ns=stamp_ns[rows],
                    position=states[rows],
                    strain=strain[rows],
                    status=missing_status(strain[rows], self.scene.layout),
                    gaps=infos[int(number)].gaps,
                )
            )
        scene, counts = self.scene, self.scene.layout.counts
        return Recording(
            str(self.path), scene.axis_names, scene.phalanx_names, tuple(sweeps), channels=counts
        )

    @property
    def _channels(self) -> int:
        """Number of channels of a strain vector, C."""
        return self.scene.layout.size

    @property
    def _columns(self) -> str:
        return BATCH_COLUMNS if self.has_checksums else UNSEALED_BATCH_COLUMNS

    def _batch(self, row: tuple[Any, ...]) -> Batch:
        return Batch.from_row(row, self.scene.dimension, self._channels)

    def _damage(self, sweeps: dict[int, SweepInfo], wanted: set[int]) -> str:
        """Description of the damaged sweeps, from all rows that can be read from either end of the table."""
        undamaged = self._undamaged_batches("ASC") | self._undamaged_batches("DESC")
        found = dict.fromkeys(wanted, 0)
        for _, sweep in undamaged:
            if sweep in found:
                found[sweep] += 1
        damaged = sorted(number for number in wanted if found[number] != sweeps[number].batches)
        if not damaged:
            return "pairs damaged"
        lost = sum(abs(sweeps[number].batches - found[number]) for number in damaged)
        total = sum(sweeps[number].batches for number in damaged)
        names = ", ".join(map(str, damaged[:_MAX_NAMED_SWEEPS])) + (
            ", ..." if len(damaged) > _MAX_NAMED_SWEEPS else ""
        )
        plural = "sweep" if len(damaged) == 1 else "sweeps"
        return f"{plural} {names} damaged, {lost} of {total} batches cannot be read"

    def _undamaged_batches(self, direction: str) -> set[tuple[int, int]]:
        """Ids and sweeps of the rows with matching checksums, up to the first unreadable page."""
        undamaged = set()
        with contextlib.suppress(*scan_file.SQLITE_ERRORS):
            for row in self._db.execute(f"SELECT {self._columns} FROM batch ORDER BY id {direction}"):
                with contextlib.suppress(ValueError):
                    batch = self._batch(row)
                    undamaged.add((batch.id, batch.sweep))
        return undamaged

    @contextlib.contextmanager
    def _snapshot(self) -> Iterator[None]:
        """Read transaction: all reads in the block see the same state of the file."""
        if self._db.in_transaction:
            yield
            return
        self._fetch("BEGIN")
        try:
            yield
        finally:
            self._fetch("COMMIT")

    def _arrays(
        self, at_most: int | None = None, progress: Progress | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        with self._snapshot():
            n = sum(info.pairs for info in self.sweeps() if not info.dropped)
            step = 1 if at_most is None else max(1, math.ceil(n / at_most))
            loaded = math.ceil(n / step)
            dimension, channels = self.scene.dimension, self._channels
            if 8 * n * (1 + dimension + channels) > self._bytes():
                raise ScanError(f"{self.path}: expected {n} pairs, the file is too small for them")
            stamp_ns = np.empty(loaded, dtype=np.int64)
            states = np.empty((loaded, dimension))
            strain = np.empty((loaded, channels))
            sweep = np.empty(loaded, dtype=np.int64)
            read = 0
            for batch in self.batches():
                pairs = len(batch)
                chosen = slice(-read % step, None, step)
                rows = slice(math.ceil(read / step), math.ceil((read + pairs) / step))
                sweep[rows], stamp_ns[rows] = batch.sweep, batch.stamp_ns[chosen]
                states[rows], strain[rows] = batch.states[chosen], batch.strain[chosen]
                read += pairs
                if progress is not None:
                    progress(read / n)
        if read != n:
            raise ScanError(f"{self.path}: expected {n} pairs, could read {read}; {scan_file.REPAIR_HINT}")
        return stamp_ns, states, strain, sweep

    def _bytes(self) -> int:
        """Size of the file and its write-ahead log."""
        files = (self.path, Path(f"{self.path}-wal"))
        return sum(file.stat().st_size for file in files if file.exists())

    def _fetch(self, query: str) -> list[tuple[Any, ...]]:
        try:
            return self._db.execute(query).fetchall()
        except scan_file.SQLITE_ERRORS as error:
            raise ScanError(
                f"{self.path}: expected a readable scan file, {scan_file.reason(error)}"
            ) from None
