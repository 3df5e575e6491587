"""A scan, which is a folder: its scene, a file for each sweep, what was learned from them, and its history.

::

    bump_scan/
      scene.yaml             scene as scanned
      sweep_0001.npy     a sweep, complete or in progress
      calibration.json   learned from the sweeps
      calibration.npz    what a filter needs of them
      history.jsonl      one line per import and recording
      dropped/           sweeps moved here are not used
"""

import json
import logging
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tactile_localizer.core.scan.scan import Scan, columns_of
from tactile_localizer.errors import ScanError, refusing
from tactile_localizer.io.recording import SCENE_OF_SCAN as SCENE
from tactile_localizer.io.recording import RecordedSweep, Recording, is_scan, scan_of
from tactile_localizer.io.scans.sweep_files import read_sweep
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.io.whole_file import open_file
from tactile_localizer.scene import Scene

_log = logging.getLogger(__name__)

HISTORY, DROPPED = "history.jsonl", "dropped"
STRAIN_DELAY, SESSIONS = "strain_delay_s", "sessions"
"""Details of an entry of the history; the second: numbers of the sweeps with which sessions begin."""

_MOST_HISTORY = 2**24
"""Bytes of the history that are read, some 50,000 lines."""
_SWEEP_FILE = re.compile(r"sweep_([0-9]{1,9})\.npy")


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
            raise ScanError(f"{self.path}: expected a scan folder, found none (with a {SCENE})")
        self.scene = load_scene(self.path / SCENE)

    def load(self) -> Scan:
        """The pairs of all sweeps, in the order of the sweeps; a warning is logged for each unused file.

        Raises
        ------
        ScanError
            As :meth:`recording`, or there are no pairs.
        """
        recording = self.recording()
        for note in recording.notes:
            _log.warning("%s", note)
        return scan_of(recording, self.scene)

    def recording(self, scene: Scene | None = None) -> Recording:
        """The sweeps in the order of their numbers, also one in progress; neither dropped nor empty ones.

        The notes have one line for each file that is not used, or not completely. Such a file has no pairs,
        is damaged, misnamed, or of another scene or unit than the sweeps before it, or it holds the same
        pairs as one of them: the map would take the second for a repetition without noise.

        Parameters
        ----------
        scene : has some of the scan's axes and phalanges, to which the recording is reduced; ``None``: all

        Raises
        ------
        ScanError
            There are files of sweeps, and none can be used.
        SceneError
            The scan lacks an axis or a phalanx of ``scene``.
        """
        own, scene = self.scene, scene or self.scene
        axes, phalanges = scene.columns(own.axis_names), scene.rows(own.phalanx_names)
        channels = scene.channels(own.phalanx_names, own.layout.counts)
        files, unused = self.files()
        sweeps: list[RecordedSweep] = []
        known: dict[int, int] = {}
        for number, file in files.items():
            try:
                sweep, damaged = read_sweep(file, number, own)
                require_new(sweep, known, str(file))
                if sweeps and sweep.strain_unit != (unit := sweeps[0].strain_unit):
                    raise ScanError(f"{file}: expected strain in {unit}, found {sweep.strain_unit}")
            except ScanError as error:
                unused.append(f"{error}; the sweep is not used")
                continue
            sweeps.append(
                replace(
                    sweep,
                    position=columns_of(sweep.position, axes),
                    strain=columns_of(sweep.strain, channels),
                    status=columns_of(sweep.status, phalanges),
                )
            )
            if not len(sweep):
                unused.append(f"{file}: sweep {number} has no pairs")
            elif damaged:
                unused.append(f"{file}: {damaged} of {len(sweep) + damaged} pairs are damaged and not used")
        if unused and not sweeps:
            raise ScanError(f"{unused[0]}, nor is any other")
        kept = tuple(filter(len, sweeps))
        return Recording(str(self.path), kept, tuple(unused), sessions=self._sessions(kept))

    def history(self) -> list[dict[str, Any]]:
        """The entries of the history, oldest first: ``at`` (ISO 8601, UTC), ``what``, and details."""
        entries: list[dict[str, Any]] = []
        with suppress(OSError), open_file(self.path / HISTORY) as file:
            for line in file.read(_MOST_HISTORY).decode("utf-8", errors="replace").splitlines():
                entry = {"at": "", "what": f"unreadable line {line[:40]!r}"}
                with suppress(ValueError, RecursionError, TypeError):
                    entry |= json.loads(line)
                entries.append(entry)
        return entries

    @property
    def strain_delay_s(self) -> float:
        """Time by which the strain of the newest import or recording was late, s, which its pairs are not."""
        delays = [entry[STRAIN_DELAY] for entry in self.history() if STRAIN_DELAY in entry]
        return float(delays[-1]) if delays and isinstance(delays[-1], int | float) else 0.0

    def _sessions(self, sweeps: Sequence[RecordedSweep]) -> tuple[int, ...]:
        """Numbers of the sweeps with which sessions begin, as noted in the history; empty: one session."""
        noted = [entry.get(SESSIONS) for entry in self.history()]
        begins = sorted({n for each in noted if isinstance(each, list) for n in each if type(n) is int})
        of_sweeps = np.searchsorted(begins, [sweep.number for sweep in sweeps], side="right")
        first = np.unique(of_sweeps, return_index=True)[1].tolist()
        return tuple(sweeps[row].number for row in first) if len(first) > 1 else ()

    def files(self, folder: str = "") -> tuple[dict[int, Path], list[str]]:
        """Files of the sweeps by number, ascending, and a line for each that is misnamed.

        Parameters
        ----------
        folder : :data:`DROPPED` for the sweeps that were dropped

        Raises
        ------
        ScanError
            The folder cannot be listed.
        """
        place = self.path / folder
        with refusing(f"{place}: could not be read", ScanError, OSError):
            found = sorted(place.iterdir()) if place.exists() else []
        files: dict[int, Path] = {}
        misnamed = []
        for file in found:
            match = _SWEEP_FILE.fullmatch(file.name)
            if match and int(match[1]) not in files:
                files[int(match[1])] = file
            elif file.name.startswith("sweep_"):
                misnamed.append(f"{file}: expected a name like sweep_0001.npy, of one sweep; it is not used")
        return dict(sorted(files.items())), misnamed


def confined(path: str, directory: str) -> Path:
    """Resolve ``path`` relative to ``directory``, following all links.

    Raises
    ------
    ScanError
        No directory is set, or the resolved path is outside it.
    """
    if not directory:
        raise ScanError("scan_directory: expected a directory of scans, found none")
    root = Path(directory).expanduser().resolve()
    try:
        resolved = (root / path).resolve()
    except (OSError, RuntimeError, ValueError):  # a loop of links, a NUL
        raise ScanError(f"{path!r}: expected a path in {root}") from None
    if root not in resolved.parents:
        raise ScanError(f"{path!r}: expected a path in {root}, found {resolved}")
    return resolved


def require_new(sweep: RecordedSweep, known: dict[int, int], where: str) -> None:
    """Require that a sweep does not hold the pairs of another one, as when a recording is given twice.

    Parameters
    ----------
    sweep : the sweep
    known : numbers of the sweeps before by their pairs, to which this one is added
    where : begin of the message

    Raises
    ------
    ScanError
        Another sweep has the same positions and strains.
    """
    pairs = hash((sweep.position.tobytes(), sweep.strain.tobytes()))
    if len(sweep) and (twin := known.setdefault(pairs, sweep.number)) != sweep.number:
        raise ScanError(
            f"{where}: expected every sweep once, found sweep {sweep.number} equal to sweep {twin}"
        )
