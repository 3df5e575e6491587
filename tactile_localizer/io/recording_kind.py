"""Which kind of recording a path leads to: a bag, a scan file, or else CSV."""

from __future__ import annotations

from pathlib import Path

from tactile_localizer.errors import ScanError

_BAG_ENDINGS = (".mcap", ".db3", ".zstd", ".zst")
_SQLITE = b"SQLite format 3\0"


def is_bag(path: Path) -> bool:
    """Whether a path is that of a bag: a folder, or a file with such an ending."""
    return path.is_dir() or path.suffix in _BAG_ENDINGS


def is_scan_file(path: Path) -> bool:
    """Whether a file is a scan file, by its first bytes.

    Raises
    ------
    ScanError
        The file cannot be read.
    """
    try:
        with path.open("rb") as file:
            return file.read(len(_SQLITE)) == _SQLITE
    except OSError as error:
        raise ScanError(f"{path}: expected a recording, {error.strerror}") from None
