"""Cache of results computed from a scan, stored in the scan file for the next start.

A result is returned only for exactly the data that it was computed from. A failure to store it costs only
the time to compute it again.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tactile_localizer.core.calibration.held_out import Calibration
from tactile_localizer.core.factory import learn
from tactile_localizer.core.likelihood.strain_map import VarianceModel
from tactile_localizer.core.scan.digest import digest_of
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ScanError
from tactile_localizer.io.scans import file as scan_file
from tactile_localizer.io.scans.lock import ScanLock
from tactile_localizer.io.scans.rows import LearnedEntry, learned_seal
from tactile_localizer.scene import Scene

_log = logging.getLogger(__name__)


class LearnedResults:
    """Cached results of one scan file, by key.

    Parameters
    ----------
    path : the scan file, which is opened for the duration of each call
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._is_reported = False

    def load_learned(self, key: str, digest: str) -> bytes | None:
        """The payload stored under ``key``; ``None`` if it is missing, damaged or computed from other data.

        Parameters
        ----------
        key : name of the result, its algorithm and version
        digest : digest of the data, from :func:`~tactile_localizer.core.scan.digest.digest_of`
        """
        try:
            connection = scan_file.open_existing(self.path, writable=False)
        except ScanError:
            return None
        with contextlib.closing(connection):
            try:
                query = "SELECT payload, seal FROM learned WHERE key = ? AND digest = ?"
                row = connection.execute(query, (key, digest)).fetchone()
            except scan_file.SQLITE_ERRORS:  # no such table yet, or damage
                return None
        if row is None or not isinstance(row[0], bytes) or row[1] != learned_seal(key, digest, row[0]):
            return None
        return bytes(row[0])

    def store_learned(self, key: str, digest: str, payload: bytes) -> bool:
        """Store ``payload`` under ``key``, replacing an earlier one; return whether that succeeded.

        A file that cannot be written (read-only, on a full disk, or being recorded) is left unchanged, and
        the first such failure is logged as a warning. Never raises a :class:`ScanError`.

        Parameters
        ----------
        key : name of the result, its algorithm and version
        digest : digest of the data that it was computed from
        payload : any bytes, for instance JSON or npz
        """
        try:
            self._store(key, digest, payload)
        except (ScanError, *scan_file.SQLITE_ERRORS, OSError) as error:
            if not self._is_reported:
                _log.warning("%s: %s could not be stored for the next start: %s", self.path, key, error)
            self._is_reported = True
            return False
        return True

    def _store(self, key: str, digest: str, payload: bytes) -> None:
        lock = ScanLock(self.path)
        try:
            connection = scan_file.open_existing(self.path, writable=True)
            try:
                connection.execute("BEGIN IMMEDIATE")
                for statement, values in LearnedEntry(key, digest, payload).statements():
                    connection.execute(statement, values)
                connection.execute("COMMIT")
            finally:
                scan_file.close(connection)
        finally:
            lock.release()


KEY = "calibration on held-out sweeps, 3"
"""Under which a calibration is kept; the number changes with how :func:`~.factory.learn` calibrates."""


def learned_calibration(
    path: Path, scan: Scan, scene: Scene, progress: Callable[[str, float], None] | None = None
) -> Calibration:
    """What :func:`~.factory.learn` learns from the scan, or what it learned from the same data before.

    Parameters
    ----------
    path : the scan file that the calibration is kept in, where that can be written
    scan, scene : what is learned from
    progress : called with what is being done and the fraction of it that is done
    """
    calibration, entry = find_calibration(path, scan, scene, progress)
    if entry is not None:
        LearnedResults(path).store_learned(*entry)
    return calibration


def find_calibration(
    path: Path, scan: Scan, scene: Scene, progress: Callable[[str, float], None] | None = None
) -> tuple[Calibration, LearnedEntry | None]:
    """The calibration of a scan, and the entry to store in the scan file; ``None`` if it is stored already.

    Takes the parameters of :func:`learned_calibration` and only reads the file.
    """
    digest = digest_of(scan, scene)
    if (kept := LearnedResults(path).load_learned(KEY, digest)) is not None:
        with contextlib.suppress(KeyError, TypeError, ValueError):
            values = json.loads(kept)
            calibration = Calibration(
                float(values["information_length"]),
                np.array(values["registration_std"], dtype=np.float64),
                values["variance"] and VarianceModel(**values["variance"]),
            )
            if calibration.registration_std.shape == (scene.dimension,):
                return calibration, None
    calibration = learn(scan, scene, progress)
    values = {
        "information_length": calibration.information_length,
        "registration_std": calibration.registration_std.tolist(),
        "variance": calibration.variance and dataclasses.asdict(calibration.variance),
    }
    return calibration, LearnedEntry(KEY, digest, json.dumps(values).encode())
