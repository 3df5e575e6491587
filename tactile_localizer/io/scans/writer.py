"""Writing a scan: its sweeps record by record.

A process that is killed loses the records that it had not written: at most 0.25 s if pairs are appended that
often.
"""

from __future__ import annotations

import fcntl
import json
import os
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from tactile_localizer import __version__
from tactile_localizer.errors import ScanError, refusing
from tactile_localizer.io.recording import SCENE_OF_SCAN as SCENE
from tactile_localizer.io.recording import RecordedSweep, is_scan
from tactile_localizer.io.scans import FORMAT
from tactile_localizer.io.scans.folder import DROPPED, HISTORY, ScanFolder
from tactile_localizer.io.scans.sweep_files import OpenSweep
from tactile_localizer.io.scene_file import require_same_scene, save_scene, scene_to_dict
from tactile_localizer.io.whole_file import writing
from tactile_localizer.scene import Scene


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
        self._history = _open_for_writing(Path(path), scene)
        try:
            super().__init__(path)
            require_same_scene(scene_to_dict(self.scene), scene_to_dict(scene), str(path))
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> ScanWriter:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Let others write."""
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
        opened.append(sweep.stamp_ns, sweep.position, sweep.strain)
        opened.end()
        if not opened.is_in_place:
            raise ScanError(f"{opened.path}: expected the sweep as written, it was removed or cut short")

    def begin_sweep(self, after_ns: int = -1, number: int | None = None) -> OpenSweep:
        """Begin a sweep of the samples after ``after_ns``, numbered one higher than the last.

        If the folder was removed, it is made again.

        Raises
        ------
        ScanError
            The file cannot be written.
        """
        if not self._is_in_place:
            history = _open_for_writing(self.path, self.scene)
            self.close()
            self._history = history
        self.restore_scene()
        number = self.last_number + 1 if number is None else number
        return OpenSweep(self.path / f"sweep_{number:04}.npy", number, self.scene, after_ns)

    def restore_scene(self) -> None:
        """Write the scene again if it was removed, which would make the sweeps unreadable.

        Raises
        ------
        ScanError
            It cannot be written.
        """
        if not is_scan(self.path):
            save_scene(self.scene, self.path / SCENE)

    @property
    def _is_in_place(self) -> bool:
        try:
            return os.path.samestat(os.fstat(self._history), (self.path / HISTORY).stat())
        except OSError:
            return False

    def note(self, what: str, **detail: Any) -> None:
        """Add a line to the history, which tells where the pairs come from.

        Raises
        ------
        ScanError
            The line cannot be written.
        """
        at = datetime.now(timezone.utc).isoformat(timespec="seconds")
        entry = {"at": at, "what": what, "version": __version__, "format": FORMAT, **detail}
        with writing(self.path / HISTORY):
            os.write(self._history, json.dumps(entry).encode() + b"\n")


def _open_for_writing(path: Path, scene: Scene) -> int:
    """Make a scan, unless there is one, and lock it; returns its history, whose closing ends the lock."""
    with refusing(f"{path}: expected a folder that can be written", ScanError, OSError):
        found = {file.name for file in path.iterdir()} if path.exists() else set()
        if SCENE not in found and any(not name.startswith((".", HISTORY)) for name in found):
            raise ScanError(f"{path}: expected a scan or an empty folder, found other files")
        path.mkdir(parents=True, exist_ok=True)
        # A pipe of this name would block.
        history = os.open(path / HISTORY, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NONBLOCK, 0o666)
    try:
        fcntl.flock(history, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if not is_scan(path):
            save_scene(scene, path / SCENE)
    except BaseException as error:
        os.close(history)
        if isinstance(error, BlockingIOError):
            raise ScanError(f"{path}: expected no other writer, another process is writing it") from None
        raise
    return history
