"""Files as a whole: reading of regular files only, and writing that appears only when it is complete.

A command replaces only what :func:`is_result`; recordings, scans and everything else of the user's stay.
"""

import errno
import os
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from tactile_localizer.errors import ScanError, TactileLocalizerError, refusing

RESULT = "result of tactile-localizer"
"""Text in the first or last bytes of each file that a command may replace."""
_ENDS = 4096
"""How many bytes these are."""


def is_result(path: str | Path) -> bool:
    """Whether a path is a file that a command wrote, which can write it again."""
    try:
        with open_file(path) as file:
            begin = file.read(_ENDS)
            file.seek(-len(begin), os.SEEK_END)
            return RESULT.encode() in begin + file.read()
    except OSError:
        return False


def open_file(path: str | Path) -> BinaryIO:
    """Open a regular file for reading; a pipe or a device could block or never end.

    Raises
    ------
    OSError
        There is no such file, or it is something else.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        found = "a directory" if path.is_dir() else "no regular file"
        raise OSError(errno.EINVAL, f"found {found}", str(path))
    return path.open("rb")


def writing(path: str | Path, error: type[TactileLocalizerError] = ScanError) -> AbstractContextManager[None]:
    """Context that turns a failure to write a file into an ``error`` that names it."""
    return refusing(f"{path}: could not be written", error, OSError)


@contextmanager
def whole_file(path: str | Path, error: type[TactileLocalizerError] = ScanError) -> Iterator[Path]:
    """Context that gives a temporary path to write to, and renames it to ``path`` on success.

    Missing folders are created. If the block raises, the temporary file is removed. If ``path`` is a symbolic
    link, its target is replaced.

    Raises
    ------
    TactileLocalizerError
        As ``error``: the file cannot be written.
    """
    target = Path(path).resolve()
    unfinished = target.with_name(f".{target.stem}.{os.getpid()}{target.suffix}")
    try:
        with writing(path, error):
            target.parent.mkdir(parents=True, exist_ok=True)
            yield unfinished
            with unfinished.open("rb") as written:
                os.fsync(written.fileno())  # otherwise power loss after the rename could leave an empty file
            unfinished.replace(target)
    finally:
        with suppress(OSError):  # it was renamed, or could not be made
            unfinished.unlink()


def write_text(path: str | Path, text: str, error: type[TactileLocalizerError] = ScanError) -> None:
    """Write a text to a file as :func:`whole_file` does; raises as that."""
    with whole_file(path, error) as unfinished:
        unfinished.write_text(text, encoding="utf-8")
