"""Files that a command writes, checked before the work whose results they will hold."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING

from tactile_localizer.errors import ParameterError
from tactile_localizer.io.whole_file import whole_file, writing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PICTURES = (".pdf", ".png", ".svg")
"""Extensions of pictures."""

_DPI = 120
"""Resolution of pictures."""


def require_writable(path: Path) -> None:
    """Require that a file can be written; its folder may be missing.

    Raises
    ------
    ScanError
        It is a folder, or no file can be made in its folder.
    """
    with writing(path):
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        folder = next(parent for parent in path.resolve().parents if parent.exists())
        with TemporaryFile(dir=folder):
            pass


def require_picture(path: Path) -> None:
    """Require that a picture can be drawn and written.

    Raises
    ------
    ParameterError
        The extension is not that of a picture.
    ScanError
        As :func:`require_writable`.
    ModuleNotFoundError
        There is no matplotlib.
    """
    import matplotlib  # noqa: F401 - takes a while, and only pictures need it

    if path.suffix.lower() not in _PICTURES:
        *others, last = _PICTURES
        raise ParameterError(f"{path}: expected a name that ends in {', '.join(others)} or {last}")
    require_writable(path)


def write_picture(path: Path, figure: Figure) -> None:
    """Write a picture that appears only when it is complete, and print its path.

    Raises
    ------
    ScanError
        The file cannot be written.
    """
    with whole_file(path) as unfinished:
        figure.savefig(unfinished, dpi=_DPI)
    print(path)
