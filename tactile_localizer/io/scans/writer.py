"""Writing a scan: its sweeps record by record.

A process that is killed loses the records that it had not written: at most 0.25 s if pairs are appended that
often.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer import __version__
from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import SCENE_OF_SCAN as SCENE
from tactile_localizer.io.recording import RecordedSweep
from tactile_localizer.io.scans.folder import DROPPED, HISTORY, ScanFolder
from tactile_localizer.io.scans.sweep_files import end_of, header_of, records_of
from tactile_localizer.io.scene_file import require_same_scene, save_scene, scene_to_dict
from tactile_localizer.scene import Scene


@dataclass(eq=False)
class OpenSweep:
    """A sweep in progress: the samples after ``after_ns`` up to ``until_ns``.

    Parameters
    ----------
    number : its number
    file : descriptor of its file
    pairs : number of pairs in it
    after_ns, until_ns : stamps, ns; ``None``: not known yet
    gaps : strain samples without a pose close enough in time
    skipped : strain samples that were missing, saturated or out of bounds
    strain_unit : for display
    """

    number: int
    file: int
    pairs: int
    after_ns: int
    until_ns: int | None = None
    gaps: int = 0
    skipped: int = 0
    strain_unit: str = "V"


class ScanWriter(ScanFolder):
    """A scan opened for writing by this process alone, created if there is none. Close it after use.

    Parameters
    ----------
    path : folder of the scan; missing parent folders are created
    scene : axes, phalanges and feature of the scan

    Raises
    ------
    ScanError
        The folder holds something else, or a scan of another scene; it cannot be written, or another
        process is writing it.
    """

    def __init__(self, path: str | Path, scene: Scene) -> None:
        path = Path(path)
        self._open: list[OpenSweep] = []
        try:
            found = {file.name for file in path.iterdir()} if path.exists() else set()
            if SCENE not in found and any(not name.startswith((".", HISTORY)) for name in found):
                raise ScanError(f"{path}: expected a scan or an empty folder, found other files")
            path.mkdir(parents=True, exist_ok=True)
            # A pipe of this name would block.
            flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NONBLOCK
            self._history = os.open(path / HISTORY, flags, 0o666)
        except OSError as error:
            raise ScanError(f"{path}: expected a folder that can be written, {error.strerror}") from None
        try:
            # The lock ends with the process that holds it.
            fcntl.flock(self._history, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if not (path / SCENE).exists():
                save_scene(scene, path / SCENE)
            super().__init__(path)
            require_same_scene(scene_to_dict(self.scene), scene_to_dict(scene), str(path))
        except BlockingIOError:
            os.close(self._history)
            raise ScanError(f"{path}: expected no other writer, another process is writing it") from None
        except BaseException:
            os.close(self._history)
            raise

    def __enter__(self) -> ScanWriter:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End the sweeps in progress and let others write.

        Raises
        ------
        ScanError
            A sweep could not be written; what is on disk is completed by the next writer.
        """
        try:
            while self._open:
                self.end_sweep(self._open[0])
        finally:
            os.close(self._history)

    @property
    def last_number(self) -> int:
        """Highest number of a sweep, dropped ones included; 0 without any."""
        return max((*self.files()[0], *self.files(DROPPED)[0]), default=0)

    def add(self, sweep: RecordedSweep) -> None:
        """Write a complete sweep, whose number must be free.

        Raises
        ------
        ScanError
            The file cannot be written.
        """
        opened = self.begin_sweep(number=sweep.number)
        opened.gaps, opened.skipped, opened.strain_unit = sweep.gaps, sweep.skipped, sweep.strain_unit
        self.append(opened, sweep.stamp_ns, sweep.position, sweep.strain)
        self.end_sweep(opened)

    def begin_sweep(self, after_ns: int = -1, number: int | None = None) -> OpenSweep:
        """Begin a sweep of the samples after ``after_ns``, numbered one higher than the last.

        Raises
        ------
        ScanError
            The file cannot be written.
        """
        number = self.last_number + 1 if number is None else number
        with self._writing(f"sweep {number}"):
            path = self.path / f"sweep_{number:04}.npy"
            sweep = OpenSweep(number, os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666), 0, after_ns)
            self._open.append(sweep)
            _write(sweep.file, header_of(self.scene, 0))
        return sweep

    def append(
        self, sweep: OpenSweep, stamp_ns: np.ndarray, position: np.ndarray, strain: np.ndarray
    ) -> None:
        """Append pairs to a sweep in progress; they are on disk when the method returns.

        Parameters
        ----------
        sweep : of :meth:`begin_sweep`
        stamp_ns : (n,) int64 stamps, ns
        position : (n, d) palm positions, m (yaw: rad), finite
        strain : (n, C) strain voltages, V, finite

        Raises
        ------
        ScanError
            The file cannot be written.
        """
        with self._writing(f"{len(stamp_ns)} pairs of sweep {sweep.number}"):
            _write(sweep.file, records_of(stamp_ns, position, strain, self.scene))
            sweep.pairs += len(stamp_ns)

    def end_sweep(self, sweep: OpenSweep) -> None:
        """Complete a sweep in progress.

        Raises
        ------
        ScanError
            The file cannot be written. The sweep has ended early.
        """
        details = {"gaps": sweep.gaps, "skipped": sweep.skipped, "strain_unit": sweep.strain_unit}
        try:
            with self._writing(f"sweep {sweep.number}"):
                _write(sweep.file, end_of(self.scene, **details))
                os.pwrite(sweep.file, header_of(self.scene, sweep.pairs), 0)
        finally:
            self.abandon_sweep(sweep)

    def abandon_sweep(self, sweep: OpenSweep) -> None:
        """Leave a sweep as it is; it has ended early unless it is complete."""
        self._open.remove(sweep)
        os.close(sweep.file)

    def note(self, what: str, **detail: Any) -> None:
        """Add a line to the history, which tells where the pairs come from.

        Raises
        ------
        ScanError
            The line cannot be written.
        """
        at = datetime.now(timezone.utc).isoformat(timespec="seconds")
        entry = {"at": at, "what": what, "version": __version__, **detail}
        with self._writing("the history"):
            os.write(self._history, json.dumps(entry).encode() + b"\n")

    @contextmanager
    def _writing(self, what: str) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise ScanError(f"{self.path}: could not write {what}, {error.strerror}") from None


def _write(file: int, content: bytes) -> None:
    """Append ``content`` to a file, on disk."""
    while content:
        content = content[os.write(file, content) :]
    os.fdatasync(file)
