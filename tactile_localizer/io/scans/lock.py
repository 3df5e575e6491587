"""One writer a scan file: an advisory lock beside it that the system drops when its holder dies."""

from __future__ import annotations

import fcntl
import os
import time
from pathlib import Path

from tactile_localizer.errors import ScanError

PATIENCE_S = 0.2
"""How long another writer is waited for, s: a filter that stores what it learned is done in milliseconds."""

_RETRY_S = 0.01


class ScanLock:
    """Exclusive right to write a scan file, held until :meth:`release` or the end of the process.

    The lock is a file beside the scan file, not the scan file itself: closing a second descriptor of
    a SQLite file would drop SQLite's own locks in this process.

    Parameters
    ----------
    scan_path : the scan file

    Raises
    ------
    ScanError
        Another writer holds the lock, or the folder cannot be written.
    """

    def __init__(self, scan_path: Path) -> None:
        self.path = Path(f"{scan_path.resolve()}.lock")  # the same by every name of the file
        try:
            self._descriptor = self._acquire(scan_path)
        except OSError as error:
            raise ScanError(f"{scan_path}: expected a folder that can be written, {error.strerror}") from None

    def release(self) -> None:
        """Let the next writer in."""
        self.path.unlink(missing_ok=True)
        os.close(self._descriptor)

    def _acquire(self, scan_path: Path) -> int:
        until = time.monotonic() + PATIENCE_S
        while True:
            descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                if time.monotonic() < until:
                    os.close(descriptor)
                    time.sleep(_RETRY_S)
                    continue
                holder = os.read(descriptor, 32).decode().strip() or "unknown"
                os.close(descriptor)
                raise ScanError(
                    f"{scan_path}: expected to be its one writer, found process {holder} writing it"
                ) from None
            # A writer that has just closed may have removed the file that was opened here.
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
