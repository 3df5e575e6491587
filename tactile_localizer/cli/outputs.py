"""Files that a command writes, checked before the work whose results they will hold."""

from __future__ import annotations

import argparse
import errno
import importlib
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Any

from tactile_localizer.cli.progress import progress_line
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.whole_file import RESULT, is_result, whole_file, write_text, writing
from tactile_localizer.offline.json_file import json_text, write_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STANDARD_OUTPUT = Path("-")
"""In place of a file of ``--json``."""

_PICTURES = (".pdf", ".png", ".svg")
"""Extensions of pictures."""

_DPI = 120
"""Resolution of pictures."""


class InputPath(str):
    """Path, or name of a shipped file, that a command reads: the type of such arguments."""

    __slots__ = ()

    def __new__(cls, text: str) -> InputPath:
        """The path in a text; a shell leaves the ``~`` of ``--scan=~/bump_scan`` to the command."""
        if not text:
            raise argparse.ArgumentTypeError("expected a path, got an empty text")
        return super().__new__(cls, os.path.expanduser(text))  # noqa: PTH111  pathlib raises without a home


def output_path(text: str) -> Path:
    """Path that a command writes: the type of such arguments."""
    return Path(InputPath(text))


@contextmanager
def results(args: argparse.Namespace) -> Iterator[Callable[[Mapping[str, Any]], None]]:
    """Context of a command whose files of ``--json``, ``--plot`` and ``--report`` can be made and written.

    It gives a function that writes the document of ``--json``, if that is wanted. Where that takes standard
    output, all else that is printed within the context goes to standard error.

    Raises
    ------
    ParameterError, ScanError, ModuleNotFoundError
        As :func:`require_writable` and :func:`require_picture`.
    """
    json, plot, report = (getattr(args, name, None) for name in ("json", "plot", "report"))
    output, takes_output = sys.stdout, json == _STANDARD_OUTPUT
    if json is not None and not takes_output:
        require_writable(json, args)
    if plot is not None:
        require_picture(plot, args)
    if report is not None:
        require_writable(report, args, "jinja2", "matplotlib")

    def write(document: Mapping[str, Any]) -> None:
        if takes_output:
            output.write(json_text(document))
        elif json is not None:
            write_json(json, document)
            print(json)

    with redirect_stdout(sys.stderr if takes_output else output):
        yield write


def require_writable(path: Path, args: argparse.Namespace, *libraries: str) -> None:
    """Require that a file can be made, and replaces none but an earlier result; its folder may be missing.

    Parameters
    ----------
    path : file to write
    args : the command line, with the inputs as :class:`InputPath`
    libraries : what else the file needs, of which an import takes a while

    Raises
    ------
    ParameterError
        It is an input, or in a folder that is one; or it exists, and is no result that this program wrote.
    ScanError
        It is a folder, or no file can be made in its folder.
    ModuleNotFoundError
        There is no such library.
    """
    for library in libraries:
        importlib.import_module(library)
    with writing(path):
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if path.exists() and not path.is_file():
            raise ParameterError(
                f"{path}: expected a file, found a pipe or a device (--json - is standard output)"
            )
        place = path.resolve()
        with TemporaryFile(dir=next(parent for parent in place.parents if parent.exists())):
            pass
    for given in vars(args).values():
        for one in given if isinstance(given, list) else [given]:
            is_input = isinstance(one, InputPath) and os.path.lexists(one)
            if is_input and Path(one).resolve() in (place, *place.parents):
                raise ParameterError(f"{path}: expected another file than the inputs, found it in {one}")
    if os.path.lexists(place) and not is_result(place):
        raise ParameterError(
            f"{path}: expected no file, or an earlier result to replace, found another file; remove it, or "
            "choose another name"
        )


def require_picture(path: Path, args: argparse.Namespace) -> None:
    """Require that a picture can be drawn and written.

    Raises
    ------
    ParameterError
        The extension is not that of a picture, or as :func:`require_writable`.
    ScanError, ModuleNotFoundError
        As :func:`require_writable`; there is no matplotlib.
    """
    if path.suffix.lower() not in _PICTURES:
        *others, last = _PICTURES
        raise ParameterError(f"{path}: expected a name that ends in {', '.join(others)} or {last}")
    require_writable(path, args, "matplotlib")


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
    write_text(path, text)
    print(path)
