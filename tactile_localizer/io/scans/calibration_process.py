"""Calibration of a scan in a separate process at low priority: ``python -m`` this module, with a path.

The process only reads the scan file and prints one JSON object per line: ``activity`` and ``fraction`` of the
progress; last ``learned``, the entry to store (``null`` if it is stored already), or ``error``. A recorder
that starts it keeps its own processor time, memory and interpreter lock.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tactile_localizer.errors import ScanError, TactileLocalizerError
from tactile_localizer.io.scans.rows import LearnedEntry

_NICENESS = 10


class CalibrationProcess:
    """A calibration that is running in another process.

    Parameters
    ----------
    path : the scan file
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        # In a separate session, so that Ctrl-C reaches only the recorder, which stops it.
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__, str(path)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def result(self, progress: Callable[[str, float], None]) -> LearnedEntry | None:
        """Wait for the end; returns the entry to store, ``None`` if it is stored already.

        Raises
        ------
        ScanError
            The scan cannot be calibrated, or the process was stopped.
        """
        message: dict[str, Any] = {}
        with self._process as process:
            assert process.stdout is not None
            for line in process.stdout:
                message = json.loads(line)
                if "activity" in message:
                    progress(message["activity"], message["fraction"])
        if "learned" not in message:
            status = self._process.returncode
            raise ScanError(message.get("error", f"{self._path}: the calibration ended with status {status}"))
        if message["learned"] is None:
            return None
        key, digest, payload = message["learned"]
        return LearnedEntry(key, digest, payload.encode())

    def stop(self) -> None:
        """End the process."""
        self._process.kill()


def main(path: str) -> None:
    """Calibrate a scan and print the progress and the result."""
    from tactile_localizer.io.scans.learned import find_calibration
    from tactile_localizer.io.scans.store import ScanStore

    def report(**message: Any) -> None:
        print(json.dumps(message), flush=True)

    os.nice(_NICENESS)
    try:
        with ScanStore.open(path) as store:
            scan, scene = store.load(), store.scene
        _, entry = find_calibration(
            Path(path), scan, scene, lambda activity, fraction: report(activity=activity, fraction=fraction)
        )
    except TactileLocalizerError as error:
        report(error=str(error))
    else:
        report(learned=entry and [entry.key, entry.digest, entry.payload.decode()])


if __name__ == "__main__":
    main(sys.argv[1])
