"""Files as a whole: reading of regular files only, and writing that appears only when it is complete."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO


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


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Context that gives a temporary path to write to, and renames it to ``path`` on success.

    If the block raises, the temporary file is removed. If ``path`` is a symbolic link, its target is
    replaced.

    Raises
    ------
    OSError
        The file cannot be written or renamed; its ``filename`` is ``path``, not the temporary one.
    """
    target = Path(path).resolve()
    unfinished = target.with_name(f".{target.stem}.{os.getpid()}{target.suffix}")
    try:
        yield unfinished
        with unfinished.open("rb") as written:
            os.fsync(written.fileno())  # otherwise power loss after the rename could leave an empty file
        unfinished.replace(target)
    except OSError as error:
        if error.errno is not None:
            raise type(error)(error.errno, error.strerror, str(path)) from None
        raise
    finally:
        with suppress(OSError):  # it was renamed, or could not be made
            unfinished.unlink()
