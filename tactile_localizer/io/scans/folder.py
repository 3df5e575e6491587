"""A scan, which is a folder: its scene, a file for each sweep, what was learned from them, and its history.

::

    bump_scan/
      scene.yaml             scene as scanned
      sweep_0001.npz         a complete sweep
      sweep_0002.recording   the sweep in progress
      calibration.json       learned from the sweeps
      history.jsonl          one line per import, recording and change
      dropped/               sweeps moved here are not used
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import SCENE_OF_SCAN as SCENE
from tactile_localizer.io.recording import RecordedSweep, Recording, is_scan, scan_of
from tactile_localizer.io.scans.sweep_files import read_recording, read_sweep, sweep_number
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.scene import Scene

HISTORY, DROPPED = "history.jsonl", "dropped"
COMPLETE, IN_PROGRESS = ".npz", ".recording"

_SWEEP_FILE = re.compile(r"sweep_\d+(\.npz|\.recording)")


class ScanFolder:
    """A scan opened for reading, also while another process records it.

    Parameters
    ----------
    path : the folder

    Attributes
    ----------
    scene : scene that the scan was recorded for

    Raises
    ------
    ScanError
        There is no such folder, or it is not a scan.
    SceneError
        Its scene cannot be read.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if not is_scan(self.path):
            raise ScanError(f"{self.path}: expected a scan folder, found {_kind(self.path)}")
        self.scene = load_scene(self.path / SCENE)

    def sweeps(self) -> list[RecordedSweep]:
        """The sweeps in the order of their numbers, also one in progress; without those that were dropped.

        Raises
        ------
        ScanError
            A sweep is damaged or belongs to another scene, two sweeps hold the same pairs, or they are in
            different units; the message names the sweep.
        """
        sweeps, damaged = [], []
        for file in self.sweep_files():
            try:
                sweeps.append(self._read(file))
            except ScanError as error:
                damaged.append((file, error))
        if damaged:
            names = ", ".join(file.name for file, _ in damaged[:8]) + (", ..." if len(damaged) > 8 else "")
            raise ScanError(
                f"{damaged[0][1]}; the other {len(sweeps)} sweeps are intact: move {names} "
                f"to {self.path / DROPPED} to use them"
            )
        require_distinct(sweeps, f"{self.path}: expected every sweep once", f"move one to {DROPPED}/")
        if len(units := sorted({sweep.strain_unit for sweep in sweeps})) > 1:
            raise ScanError(f"{self.path}: expected one unit of the strain, found {' and '.join(units)}")
        return sweeps

    def load(self) -> Scan:
        """The pairs of all sweeps, in the order of the sweeps.

        Raises
        ------
        ScanError
            As :meth:`sweeps`, or there are no pairs.
        """
        return scan_of(self.recording(), self.scene)

    def recording(self, scene: Scene | None = None) -> Recording:
        """The same pairs as a recording, by sweep and with their stamps; empty sweeps are left out.

        Parameters
        ----------
        scene : has some of the scan's axes and phalanges, to which the recording is reduced; ``None``: all

        Raises
        ------
        ScanError
            As :meth:`sweeps`.
        SceneError
            The scan lacks an axis or a phalanx of ``scene``.
        """
        own, scene = self.scene, scene or self.scene
        axes, phalanges = scene.columns(own.axis_names), scene.rows(own.phalanx_names)
        channels = scene.channels(own.phalanx_names, own.layout.counts)
        sweeps = tuple(
            replace(
                sweep,
                position=sweep.position[:, axes],
                strain=sweep.strain[:, channels],
                status=sweep.status[:, phalanges],
            )
            for sweep in self.sweeps()
            if len(sweep)
        )
        return Recording(str(self.path), sweeps)

    def history(self) -> list[dict[str, Any]]:
        """The entries of the history, oldest first: ``at`` (ISO 8601, UTC), ``what``, and details."""
        entries = []
        try:
            lines = (self.path / HISTORY).read_text(encoding="utf-8", errors="replace").splitlines()
        except OSError:
            lines = []
        for line in lines:
            try:
                entry = json.loads(line)
                entries.append({"at": str(entry.pop("at")), "what": str(entry.pop("what")), **entry})
            except (ValueError, RecursionError, LookupError, AttributeError, TypeError):
                entries.append({"at": "", "what": f"unreadable line {line[:40]!r}"})
        return entries

    def dropped_files(self) -> list[Path]:
        """Files of the sweeps that were dropped."""
        return self.sweep_files(DROPPED)

    def sweep_files(self, folder: str = "") -> list[Path]:
        """Files of the sweeps in the order of their numbers; ``folder`` is that of the dropped sweeps.

        A sweep of which there are both is complete: its recording was not removed yet.

        Raises
        ------
        ScanError
            The folder cannot be listed, or an npz is not named as a sweep.
        """
        place = self.path / folder
        try:
            names = sorted(entry.name for entry in place.iterdir()) if place.exists() else []
        except OSError as error:
            raise ScanError(f"{place}: could not be read, {error.strerror}") from None
        files: dict[int, Path] = {}
        for name in reversed(names):  # sweep_0001.npz replaces sweep_0001.recording
            if _SWEEP_FILE.fullmatch(name):
                number = sweep_number(place / name)
                if number in files and files[number].suffix == Path(name).suffix:
                    raise ScanError(f"{place / name}: expected one file of sweep {number}, found another")
                files[number] = place / name
            elif name.endswith(COMPLETE) and not name.startswith("."):
                raise ScanError(f"{place / name}: expected a name like sweep_0001{COMPLETE}")
        return [files[number] for number in sorted(files)]

    def _read(self, file: Path) -> RecordedSweep:
        try:
            if file.suffix == IN_PROGRESS:
                with suppress(FileNotFoundError):  # completed in the meantime
                    return read_recording(file, self.scene)
            return read_sweep(file.with_suffix(COMPLETE), self.scene)
        except OSError as error:
            raise ScanError(f"{file}: could not be read, {error.strerror}") from None


def require_distinct(sweeps: Sequence[RecordedSweep], expected: str, advice: str) -> None:
    """Require that no two sweeps hold the same positions and strains, as when a recording is given twice.

    The map would take the second for a repetition without noise.

    Raises
    ------
    ScanError
        Two sweeps are equal.
    """
    first: dict[int, int] = {}
    for sweep in sweeps:
        pairs = hash((sweep.position.tobytes(), sweep.strain.tobytes()))
        if len(sweep) and first.setdefault(pairs, sweep.number) != sweep.number:
            twin = first[pairs]
            raise ScanError(f"{expected}, found sweep {sweep.number} equal to sweep {twin}; {advice}")


def _kind(path: Path) -> str:
    try:
        if not path.exists():
            return "none"
        return f"a folder without {SCENE}" if path.is_dir() else "a file"
    except (OSError, ValueError) as error:
        return getattr(error, "strerror", "") or str(error)
