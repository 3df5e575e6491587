"""Files that appear, or take the place of what was there, only when all of them is written."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """A path to write to: it becomes ``path`` when the block ends well, and is gone when it fails.

    A link stays one: what it leads to is written.

    Raises
    ------
    OSError
        The file cannot be put in its place.
    """
    target = Path(path).resolve()
    unfinished = target.with_name(f".{target.stem}.{os.getpid()}{target.suffix}")
    try:
        yield unfinished
        with unfinished.open("rb") as written:
            os.fsync(written.fileno())  # else power loss after the replacement could leave an empty file
        unfinished.replace(target)
    finally:
        unfinished.unlink(missing_ok=True)
