"""Files that a command writes, checked before the work whose results they will hold."""

from __future__ import annotations

import argparse
import errno
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING

from tactile_localizer.cli.progress import progress_line
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.whole_file import RESULT, is_result, whole_file, writing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PICTURES = (".pdf", ".png", ".svg")
"""Extensions of pictures."""

_INPUTS = (
    "recordings",
    "scan",
    "scene",
    "config",
    "configurations",
    "columns",
    "poses",
    "adapter",
    "definitions",
    "dbc",
)
"""Arguments of commands that name what is read."""

_DPI = 120
"""Resolution of pictures."""


def require_writable(path: Path, args: argparse.Namespace) -> None:
    """Require that a file can be written and replaces none but an earlier result; its folder may be missing.

    Parameters
    ----------
    path : file to write
    args : the command line, with the inputs of :data:`_INPUTS`

    Raises
    ------
    ParameterError
        It is an input, or in a folder that is one, also by another name (links); or it exists, and is no
        result that this program wrote.
    ScanError
        It is a folder, or no file can be made in its folder.
    """
    with writing(path):
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        place = path.resolve()
        folder = next(parent for parent in place.parents if parent.exists())
        with TemporaryFile(dir=folder):
            pass
        hard_linked = path.exists() and path.stat().st_nlink > 1
    own = _identities((place, *place.parents))
    for given in _inputs(args):
        inside = given.glob("**/*") if hard_linked else ()
        if own & _identities((given, *inside)):
            raise ParameterError(f"{path}: expected another file than the inputs, found it in {given}")
    if os.path.lexists(place) and not is_result(place):
        raise ParameterError(
            f"{path}: expected no file, or an earlier result to replace, found another file; remove it, or "
            "choose another name"
        )


def _inputs(args: argparse.Namespace) -> Iterator[Path]:
    """Files and folders that the command line names as inputs."""
    for name in _INPUTS:
        value = getattr(args, name, None) or ()
        yield from map(Path, [value] if isinstance(value, str) else value)


def _identities(paths: Iterable[Path]) -> set[tuple[int, int]]:
    """Device and inode of those that exist, which are the same under all names of a file."""
    found = set()
    for path in paths:
        with suppress(OSError, ValueError):  # it does not exist, or cannot
            stat = path.stat()
            found.add((stat.st_dev, stat.st_ino))
    return found


def require_picture(path: Path, args: argparse.Namespace) -> None:
    """Require that a picture can be drawn and written.

    Raises
    ------
    ParameterError
        The extension is not that of a picture, or as :func:`require_writable`.
    ScanError
        As :func:`require_writable`.
    ModuleNotFoundError
        There is no matplotlib.
    """
    import matplotlib  # noqa: F401 - takes a while, and only pictures need it

    if path.suffix.lower() not in _PICTURES:
        *others, last = _PICTURES
        raise ParameterError(f"{path}: expected a name that ends in {', '.join(others)} or {last}")
    require_writable(path, args)


def write_picture(path: Path, figure: Figure) -> None:
    """Write a picture that appears only when it is complete, and print its path.

    Raises
    ------
    ScanError
        The file cannot be written.
    """
    with whole_file(path) as unfinished:
        figure.savefig(unfinished, dpi=_DPI, metadata={"Title": RESULT})
    print(path)


def require_report(path: Path, args: argparse.Namespace) -> None:
    """Require that a report can be made and written.

    Raises
    ------
    ParameterError, ScanError
        As :func:`require_writable`.
    ModuleNotFoundError
        There is no jinja2 or matplotlib.
    """
    import jinja2  # noqa: F401 - takes a while, and only reports need it
    import matplotlib  # noqa: F401 - as jinja2

    require_writable(path, args)


def write_report(path: Path, page: Callable[[], str]) -> None:
    """Make and write a report that appears only when it is complete, and print its path.

    Raises
    ------
    ScanError
        The file cannot be written.
    """
    with progress_line() as progress:
        progress("drawing the report", 0.0)
        text = page()
    with whole_file(path) as unfinished:
        unfinished.write_text(text, encoding="utf-8")
    print(path)
