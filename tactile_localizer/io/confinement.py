"""Paths that come from outside, kept inside a directory that the operator named."""

from __future__ import annotations

from pathlib import Path

from tactile_localizer.errors import ScanError


def confined(path: str, directory: str) -> Path:
    """``path``, relative to ``directory`` or inside it, with all links followed.

    Raises
    ------
    ScanError
        No directory was named, or the path leads out of it.
    """
    if not directory:
        raise ScanError("scan_directory: expected a directory that scan files may be read from, found none")
    root = Path(directory).expanduser().resolve()
    try:
        place = (root / path).resolve()
    except (OSError, RuntimeError, ValueError):  # a loop of links, a NUL
        raise ScanError(f"{path!r}: expected a path in {root}") from None
    if root not in place.parents:
        raise ScanError(f"{path!r}: expected a path in {root}, found {place}")
    return place
