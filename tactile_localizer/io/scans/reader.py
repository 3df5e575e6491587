"""Reading a scan file: its sweeps, its pairs and its history, every row checked against its seal."""

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
from tactile_localizer.io.scans import batch as batch_rows
from tactile_localizer.io.scans import file as scan_file
from tactile_localizer.io.scans.batch import Batch
from tactile_localizer.io.scans.seals import contents_seal, sweep_seal
from tactile_localizer.io.scans.sweep_info import SweepInfo
from tactile_localizer.io.scene_file import scene_from_dict
from tactile_localizer.scene import Scene

Progress = Callable[[float], None]

_NAMED = 8
"""Most damaged sweeps that a message names."""

_SWEEPS_OF_SCHEMA_1 = (
    "SELECT number, ended, gaps, skipped, dropped, count(batch.id), coalesce(sum(pairs), 0),"
    " coalesce(min(first_ns), 0), coalesce(max(last_ns), 0), 0"
    " FROM sweep LEFT JOIN batch ON batch.sweep = sweep.number GROUP BY number ORDER BY number"
)


class ScanReader:
    """A scan file, open for reading.

    Parameters
    ----------
    path : for messages
    connection : to the file, from :mod:`~tactile_localizer.io.scans.file`; closed where this fails

    Attributes
    ----------
    scene : what the scan was recorded for
    units : of stamps, states and strain, for people

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
        """Whether damage of the file would be noticed: from schema version 2 on."""
        return self._schema > 1

    def close(self) -> None:
        """Close the file."""
        scan_file.close(self._db)

    def sweeps(self) -> list[SweepInfo]:
        """The sweeps, by number, dropped ones included.

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
                    raise ValueError("the checksum does not fit")
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
        """The file's history, oldest first: time (ISO 8601, UTC), what was done, its details."""
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

    def load(self, at_most: int | None = None, progress: Progress | None = None) -> Scan:
        """The pairs of the sweeps that are not dropped, in the order in which they were recorded.

        Parameters
        ----------
        at_most : of a longer scan, load each second, third, ... pair, so that it is no more pairs than this
        progress : called with the share that is loaded, 0 to 1

        Raises
        ------
        ScanError
            A sweep is damaged (names it), or the file holds no pairs.
        """
        _, states, strain, sweep = self._arrays(at_most, progress)
        if not len(states):
            raise ScanError(f"{self.path}: expected at least one state-measurement pair, found none")
        scene = self.scene
        return Scan(states, strain, sweep, scene.axis_names, scene.phalanx_names, scene.layout.counts)

    def batches(self) -> Iterator[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:
        """The same pairs in parts, so that a long scan takes no more memory than a short one.

        Yields
        ------
        sweep : int
            Its number.
        stamp_ns : numpy.ndarray, (n,)
        states : numpy.ndarray, (n, d)
        strain : numpy.ndarray, (n, C)

        Raises
        ------
        ScanError
            A sweep is damaged; names it.
        """
        for batch in self.checked_batches():
            yield batch.sweep, batch.stamp_ns, batch.states, batch.strain

    def checked_batches(self, *, of_dropped: bool = False) -> Iterator[Batch]:
        """The rows of pairs, in the order in which they were recorded, each checked.

        Parameters
        ----------
        of_dropped : those of dropped sweeps too

        Raises
        ------
        ScanError
            A sweep is damaged; names it.
        """
        with self._snapshot():
            sweeps = {info.number: info for info in self.sweeps()}
            wanted = {number for number, info in sweeps.items() if of_dropped or not info.dropped}
            found = dict.fromkeys(wanted, 0)
            last, reason = -1, None
            try:
                for row in self._db.execute(f"SELECT {self._columns} FROM batch ORDER BY id"):
                    if row[1] not in sweeps:
                        raise ValueError(f"expected pairs of a known sweep, found some of {row[1]!r:.20}")
                    if row[1] in wanted:
                        batch = self._batch(row)
                        if batch.id <= last:  # SQLite believes that the pages of its tree are in order
                            raise ValueError(f"expected parts in order, found {batch.id} after {last}")
                        last = batch.id
                        found[batch.sweep] += 1
                        yield batch
            except (*scan_file.SQLITE_ERRORS, ValueError) as error:
                reason = scan_file.in_words(error)
            lost = {number: sweeps[number].batches - found[number] for number in wanted}
            if reason is not None or any(lost.values()):
                damage = " ".join(filter(None, (self._damage(sweeps, wanted), reason and f"({reason})")))
                raise ScanError(f"{self.path}: {damage}; {scan_file.REPAIR_HINT}")

    def recording(self) -> Recording:
        """The same pairs by sweep and with their stamps, as any other recording.

        Raises
        ------
        ScanError
            A sweep is damaged; names it.
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
                    status=missing_status(strain[mine], self.scene.layout),
                    gaps=infos[int(number)].gaps,
                )
            )
        scene, counts = self.scene, self.scene.layout.counts
        return Recording(
            str(self.path), scene.axis_names, scene.phalanx_names, tuple(sweeps), channels=counts
        )

    @property
    def _channels(self) -> int:
        """Channels of a strain vector."""
        return self.scene.layout.size

    @property
    def _columns(self) -> str:
        return batch_rows.COLUMNS if self.has_checksums else batch_rows.UNSEALED_COLUMNS

    def _batch(self, row: tuple[Any, ...]) -> Batch:
        return Batch.from_row(row, self.scene.dimension, self._channels)

    def _damage(self, sweeps: dict[int, SweepInfo], wanted: set[int]) -> str:
        """Names the damaged sweeps, after a look at every row that can be read from either end."""
        whole = self._whole_batches("ASC") | self._whole_batches("DESC")
        found = dict.fromkeys(wanted, 0)
        for _, sweep in whole:
            if sweep in found:
                found[sweep] += 1
        damaged = sorted(number for number in wanted if found[number] != sweeps[number].batches)
        if not damaged:
            return "pairs damaged"
        lost = sum(abs(sweeps[number].batches - found[number]) for number in damaged)
        total = sum(sweeps[number].batches for number in damaged)
        names = ", ".join(map(str, damaged[:_NAMED])) + (", ..." if len(damaged) > _NAMED else "")
        plural = "sweep" if len(damaged) == 1 else "sweeps"
        return f"{plural} {names} damaged, {lost} of {total} parts cannot be read"

    def _whole_batches(self, direction: str) -> set[tuple[int, int]]:
        """Ids and sweeps of the rows that fit their seals, read until the file cannot be read further."""
        whole = set()
        with contextlib.suppress(*scan_file.SQLITE_ERRORS):
            for row in self._db.execute(f"SELECT {self._columns} FROM batch ORDER BY id {direction}"):
                with contextlib.suppress(ValueError):
                    batch = self._batch(row)
                    whole.add((batch.id, batch.sweep))
        return whole

    @contextlib.contextmanager
    def _snapshot(self) -> Iterator[None]:
        """Everything that is read in the block is as of one moment, whatever is appended meanwhile."""
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
                raise ScanError(f"{self.path}: expected {n} pairs, found a file too small for them")
            stamp_ns = np.empty(loaded, dtype=np.int64)
            states = np.empty((loaded, dimension))
            strain = np.empty((loaded, channels))
            sweep = np.empty(loaded, dtype=np.int64)
            read = 0
            for number, *batch in self.batches():
                pairs = len(batch[0])
                mine = slice(-read % step, None, step)
                rows = slice(math.ceil(read / step), math.ceil((read + pairs) / step))
                sweep[rows] = number
                stamp_ns[rows], states[rows], strain[rows] = (part[mine] for part in batch)
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
                f"{self.path}: expected a scan file that can be read, {scan_file.reason(error)}"
            ) from None
