"""Confinement of paths from service requests to a directory chosen by the operator."""

from pathlib import Path

from tactile_localizer.errors import ScanError


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
