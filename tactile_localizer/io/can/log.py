"""Recorded CAN traffic: candump's logs, and whatever else python-can reads."""

from __future__ import annotations

import gzip
import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can

from tactile_localizer.errors import CanError

BATCH = 256
"""Most frames that are handed out at once."""

_LINE = re.compile(r"\s*(\(\d+(\.\d+)?\)\s+\S+\s+[0-9A-Fa-f]+#[0-9A-Fa-fRr#]*(\s+[TR])?)?\s*", re.ASCII)
"""A line as ``candump -l`` writes it, or an empty one."""

_LATEST_S = 9e9
"""Largest stamp, s: in the year 2255, and the last that nanoseconds in 64 bits can count."""

_ERROR_FRAME = re.compile(r" [23][0-9A-Fa-f]{7}#")


def read_log(
    path: Path, channel: str | None = None, seconds: float | None = None
) -> Iterator[list[can.Message]]:
    """Frames of a log, in its order.

    Parameters
    ----------
    path : candump log (``.log``), ASC, BLF or another format of python-can, by its ending; gzipped too
    channel : the only one to read, where the log has several
    seconds : how much of the log, s from its first frame; ``None``: all

    Raises
    ------
    CanError
        The log cannot be read, or has frames of several channels and none was chosen.
    """
    messages: list[can.Message] = []
    first_s: float | None = None
    found: set[str] = set()
    for message in _frames(path):
        if message.channel is not None:  # what python-can does not tell of candump's error frames
            if channel not in (None, str(message.channel)):
                continue
            found.add(str(message.channel))
            if len(found) > 1:
                both = " and ".join(sorted(found))
                raise CanError(
                    f"{path}: expected frames of one channel, found {both}: choose one by --channel"
                )
        if not abs(message.timestamp) <= _LATEST_S:
            raise CanError(f"{path}: expected stamps of at most {_LATEST_S:g} s, found {message.timestamp:g}")
        first_s = message.timestamp if first_s is None else first_s
        if seconds is not None and message.timestamp - first_s > seconds:
            break
        messages.append(message)
        if len(messages) == BATCH:
            yield messages
            messages = []
    yield messages


def _frames(path: Path) -> Iterator[can.Message]:
    is_candump = path.suffix == ".log" or path.suffixes[-2:] == [".log", ".gz"]
    try:
        # python-can asks for a TextIO, and uses what any file of lines has.
        lines: Any = _Candump(path, _text(path)) if is_candump else None
        with can.CanutilsLogReader(lines) if is_candump else can.LogReader(path) as reader:
            yield from reader
    except CanError:
        raise
    except OSError as error:
        raise CanError(f"{path}: expected a CAN log, {error.strerror or error}") from error
    except Exception as error:  # each format's reader raises what it likes
        raise CanError(f"{path}: expected a CAN log, {' '.join(str(error).split())}") from error


def _text(path: Path) -> Any:
    """A file of lines, opened before there is a reader that would have to be closed where that fails."""
    return (gzip.open if path.suffix == ".gz" else open)(path, "rt", encoding="utf-8", errors="replace")


class _Candump(io.TextIOBase):
    """A candump log whose lines are checked, and whose error frames are of every class."""

    def __init__(self, path: Path, lines: Any) -> None:
        self._path = path
        self._number = 0
        self._lines = lines

    def readline(self, size: int | None = -1) -> str:  # type: ignore[override]
        line = self._lines.readline()
        self._number += 1
        if not _LINE.fullmatch(line):
            raise CanError(
                f"{self._path} line {self._number}: expected a frame as candump -l writes it, found "
                f"{line.strip()[:60]!r}"
            )
        return _ERROR_FRAME.sub(" 20000080#", line)

    def close(self) -> None:
        self._lines.close()
        super().close()
