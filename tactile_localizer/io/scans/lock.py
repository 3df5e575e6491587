"""Advisory lock that gives one process the right to write a scan file, released when the process dies."""

from __future__ import annotations

import fcntl
import os
import time
from pathlib import Path

from tactile_localizer.errors import ScanError

LOCK_TIMEOUT_S = 0.2
"""Longest wait for another writer, s; a filter that stores cached results holds the lock for milliseconds."""

_RETRY_PERIOD_S = 0.01


class ScanLock:
    """Exclusive right to write a scan file, held until :meth:`release` or the end of the process.

    The lock is a separate file beside the scan file: closing a second descriptor of an SQLite file would
    release SQLite's own locks in this process.

    Parameters
    ----------
    scan_path : the scan file

    Raises
    ------
    ScanError
        Another process holds the lock, or the folder is not writable.
    """

    def __init__(self, scan_path: Path) -> None:
        self.path = Path(f"{scan_path.resolve()}.lock")  # one lock for all links to the file
        try:
            self._descriptor = self._acquire(scan_path)
        except OSError as error:
            raise ScanError(f"{scan_path}: expected a writable folder, {error.strerror}") from None

    def release(self) -> None:
        """Release the lock and remove its file."""
        self.path.unlink(missing_ok=True)
        os.close(self._descriptor)

    def _acquire(self, scan_path: Path) -> int:
        deadline_s = time.monotonic() + LOCK_TIMEOUT_S
        while True:
            descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                if time.monotonic() < deadline_s:
                    os.close(descriptor)
                    time.sleep(_RETRY_PERIOD_S)
                    continue
                holder = os.read(descriptor, 32).decode().strip() or "unknown"
                os.close(descriptor)
                raise ScanError(
                    f"{scan_path}: expected no other writer, process {holder} is writing the file"
                ) from None
            # Another writer may have removed the lock file between opening and locking it.
            if self._is_current(descriptor):
                break
            os.close(descriptor)
        try:
            os.ftruncate(descriptor, 0)
            os.write(descriptor, str(os.getpid()).encode())
        except OSError:
            self.path.unlink(missing_ok=True)
            os.close(descriptor)
            raise
        return descriptor

    def _is_current(self, descriptor: int) -> bool:
        try:
            found = self.path.stat()
        except FileNotFoundError:
            return False
        return os.path.samestat(found, os.fstat(descriptor))
