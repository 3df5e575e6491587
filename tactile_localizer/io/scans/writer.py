"""Writing a scan: the sweep in progress record by record, complete sweeps as whole files.

A process that is killed loses the records that it had not written: at most 0.25 s if pairs are appended that
often. The next writer turns what it left into a sweep that ended early.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from tactile_localizer import __version__
from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import ENDED, ENDED_EARLY, RecordedSweep
from tactile_localizer.io.recording import SCENE_OF_SCAN as SCENE
from tactile_localizer.io.scans.folder import (
    COMPLETE,
    HISTORY,
    IN_PROGRESS,
    ScanFolder,
)
from tactile_localizer.io.scans.sweep_files import (
    read_recording,
    records,
    sweep_number,
    write_sweep,
)
from tactile_localizer.io.scene_file import save_scene
from tactile_localizer.scene import Scene


@dataclass(eq=False)
class OpenSweep:
    """A sweep in progress.

    Parameters
    ----------
    number : its number
    file : descriptor of its recording
    gaps : strain samples without a pose close enough in time
    skipped : strain samples that were missing, saturated or out of bounds
    """

    number: int
    file: int
    gaps: int = 0
    skipped: int = 0


class ScanWriter(ScanFolder):
    """A scan opened for writing by this process alone, created if there is none. Close it after use.

    Parameters
    ----------
    path : folder of the scan; missing parent folders are created
    scene : axes, phalanges and feature of the scan
    strain_unit : unit of the strain of new sweeps, for display

    Raises
    ------
    ScanError
        The folder holds something else, or a scan of another scene; it cannot be written, or another
        process is writing it.
    """

    def __init__(self, path: str | Path, scene: Scene, *, strain_unit: str = "V") -> None:
        path = Path(path)
        self._strain_unit = strain_unit
        self._open: list[OpenSweep] = []
        try:
            found = {file.name for file in path.iterdir()} if path.exists() else set()
            if SCENE not in found and any(not name.startswith((".", HISTORY)) for name in found):
                raise ScanError(f"{path}: expected a scan or an empty folder, found other files")
            path.mkdir(parents=True, exist_ok=True)
            self._history = (path / HISTORY).open("ab", buffering=0)
        except OSError as error:
            raise ScanError(f"{path}: expected a folder that can be written, {error.strerror}") from None
        try:
            # The lock ends with the process that holds it.
            fcntl.flock(self._history, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if not (path / SCENE).exists():
                save_scene(scene, path / SCENE)
            super().__init__(path)
            require_same_scene(self.scene, scene, str(path))
            self._finish_interrupted()
        except BlockingIOError:
            self._history.close()
            raise ScanError(f"{path}: expected no other writer, another process is writing it") from None
        except BaseException:
            self._history.close()
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
            self._history.close()

    @property
    def last_number(self) -> int:
        """Highest number of a sweep, dropped ones included; 0 without any."""
        files = (*self.sweep_files(), *self.dropped_files())
        return max(map(sweep_number, files), default=0)

    def add(self, sweep: RecordedSweep) -> None:
        """Write a complete sweep, whose number must be free.

        Raises
        ------
        ScanError
            The file cannot be written.
        """
        with self._writing(f"sweep {sweep.number}"):
            sweep = replace(sweep, strain_unit=self._strain_unit)
            write_sweep(self._file(sweep.number, COMPLETE), sweep, self.scene)

    def begin_sweep(self) -> OpenSweep:
        """Begin a sweep, numbered one higher than the last.

        Raises
        ------
        ScanError
            The file cannot be written.
        """
        self._finish_interrupted()
        number = self.last_number + 1
        with self._writing(f"sweep {number}"):
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND
            sweep = OpenSweep(number, os.open(self._file(number, IN_PROGRESS), flags, 0o666))
        self._open.append(sweep)
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
        content = records(stamp_ns, position, strain, self.scene).tobytes()
        with self._writing(f"{len(stamp_ns)} pairs of sweep {sweep.number}"):
            size = os.fstat(sweep.file).st_size
            try:
                if os.write(sweep.file, content) < len(content):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                os.fdatasync(sweep.file)
            except OSError:
                with suppress(OSError):  # a part of a record would shift those appended later
                    os.ftruncate(sweep.file, size)
                raise

    def end_sweep(self, sweep: OpenSweep) -> None:
        """Complete a sweep in progress.

        Raises
        ------
        ScanError
            The file cannot be written. The sweep ends nevertheless; it is completed when the next one
            begins, or by the next writer.
        """
        self._open.remove(sweep)
        os.close(sweep.file)
        self._complete(sweep.number, ENDED, sweep.gaps, sweep.skipped)

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
            self._history.write(json.dumps(entry).encode() + b"\n")

    def _finish_interrupted(self) -> None:
        """Complete the sweeps that a killed process, or a full disk, has left in progress."""
        interrupted = set(map(sweep_number, self.path.glob(f"sweep_*{IN_PROGRESS}")))
        for number in sorted(interrupted - {sweep.number for sweep in self._open}):
            self._complete(number, ENDED_EARLY)
            self.note(ENDED_EARLY, sweep=number)

    def _complete(self, number: int, ending: str, gaps: int = 0, skipped: int = 0) -> None:
        """Make a sweep of its recording."""
        recording = self._file(number, IN_PROGRESS)
        with self._writing(f"sweep {number}"):
            if not self._file(number, COMPLETE).exists():
                sweep = read_recording(recording, self.scene)
                self.add(replace(sweep, gaps=gaps, skipped=sweep.skipped + skipped, ending=ending))
            recording.unlink()

    def _file(self, number: int, suffix: str) -> Path:
        return self.path / f"sweep_{number:04}{suffix}"

    @contextmanager
    def _writing(self, what: str) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise ScanError(f"{self.path}: could not write {what}, {error.strerror}") from None


@contextmanager
def new_scan(path: str | Path, scene: Scene, *, strain_unit: str = "V") -> Iterator[ScanWriter]:
    """Context that writes a scan under a temporary name and renames it to ``path`` on success.

    If the block raises, nothing is left behind.

    Parameters
    ----------
    path : must not exist yet; missing parent folders are created
    scene, strain_unit : as of :class:`ScanWriter`

    Raises
    ------
    ScanError
        The folder exists, or could not be written completely.
    """
    path = Path(path)
    if path.exists():
        raise ScanError(f"{path}: expected no folder of this name, found one; choose another or remove it")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        folder = TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent)
    except OSError as error:
        raise ScanError(f"{path}: expected a writable folder, {error.strerror}") from None
    with folder:
        unfinished = Path(folder.name, path.name)
        try:
            with ScanWriter(unfinished, scene, strain_unit=strain_unit) as writer:
                yield writer
        except ScanError as error:  # that names the folder which the user knows
            raise ScanError(str(error).replace(str(unfinished), str(path))) from None
        unfinished.rename(path)


def require_same_scene(found: Scene, expected: Scene, where: str) -> None:
    """Require that pairs of both scenes can share one scan: same axes, bounds, phalanges and name.

    Raises
    ------
    ScanError
        The scenes differ; the message names the difference.
    """
    described = [
        {
            "axes": ", ".join(f"{axis.name} {axis.lower:.9g} to {axis.upper:.9g}" for axis in scene.axes),
            "phalanges": ", ".join(f"{each.name} ({each.channels} channels)" for each in scene.phalanges),
            "phalanx offsets": f"{[tuple(map(float, each.offset)) for each in scene.phalanges]}",
            "name": scene.name,
        }
        for scene in (expected, found)
    ]
    for what, text in described[0].items():
        if described[1][what] != text:
            raise ScanError(f"{where}: expected {what} {text}, found {described[1][what]}")
