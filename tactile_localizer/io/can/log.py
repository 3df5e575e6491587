"""Reading logs of CAN traffic: candump logs and the other formats of python-can.

python-can reads most error frames in candump logs as data frames, and reports malformed lines without
their number. Candump logs are therefore validated line by line before python-can parses them.
"""

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
"""Most frames returned at once."""

_LINE = re.compile(r"\s*(\(\d+(\.\d+)?\)\s+\S+\s+[0-9A-Fa-f]+#[0-9A-Fa-fRr#]*(\s+[TR])?)?\s*", re.ASCII)
"""A line in the format of ``candump -l``, or an empty line."""

_LATEST_S = 9e9
"""Largest stamp, s: in the year 2255; later ones do not fit into 64 bits as ns."""

_ERROR_FRAME = re.compile(r" [23][0-9A-Fa-f]{7}#")
"""Identifier of an error frame of any class."""


def read_log(
    path: Path, channel: str | None = None, seconds: float | None = None
) -> Iterator[list[can.Message]]:
    """Read the frames of a log, in batches.

    Parameters
    ----------
    path : candump log (``.log``), ASC, BLF or another format of python-can, by its extension; may be gzipped
    channel : channel to read, if the log has several
    seconds : duration to read from the first frame on, s; ``None``: the whole log

    Raises
    ------
    CanError
        The log cannot be read, or has frames of several channels and none is chosen.
    """
    messages: list[can.Message] = []
    first_s: float | None = None
    found: set[str] = set()
    for message in _frames(path):
        if message.channel is not None:  # python-can drops the channel of error frames
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
        # python-can is typed for TextIO, but only iterates over the lines.
        lines: Any = _Candump(path, _text(path)) if is_candump else None
        with can.CanutilsLogReader(lines) if is_candump else can.LogReader(path) as reader:
            yield from reader
    except CanError:
        raise
    except OSError as error:
        raise CanError(f"{path}: expected a CAN log, {error.strerror or error}") from error
    except Exception as error:  # readers raise many types of exceptions
        raise CanError(f"{path}: expected a CAN log, {' '.join(str(error).split())}") from error


def _text(path: Path) -> Any:
    """Open a text file, possibly gzipped; before the reader exists, so that a failure leaks nothing."""
    return (gzip.open if path.suffix == ".gz" else open)(path, "rt", encoding="utf-8", errors="replace")


class _Candump(io.TextIOBase):
    """Validated lines of a candump log, with error frames rewritten to a class that python-can knows."""

    def __init__(self, path: Path, lines: Any) -> None:
        self._path = path
        self._number = 0
        self._lines = lines

    def readline(self, size: int | None = -1) -> str:  # type: ignore[override]
        line = self._lines.readline()
        self._number += 1
        if not _LINE.fullmatch(line):
            raise CanError(
                f"{self._path} line {self._number}: expected a frame in the format of candump -l, found "
                f"{line.strip()[:60]!r}"
            )
        return _ERROR_FRAME.sub(" 20000080#", line)

    def close(self) -> None:
        self._lines.close()
        super().close()
