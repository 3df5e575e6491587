"""Rows of a table in a text file: compression, encoding, separator and header are found in the file."""

import codecs
import csv
import gzip
import io
import os
import re
import zlib
from collections.abc import Collection, Iterator
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from tactile_localizer.errors import ScanError, refusing
from tactile_localizer.io.whole_file import open_file

_MOST_NUMBERS = 25_000_000
"""Most numbers of a file, which take 0.2 GB, several times: 20 min of 16 channels at 1 kHz."""
_MAX_LINE = 2**20
"""Longest line, characters: a file of another kind could be one."""
_HEAD = 200
"""Lines in which the header is searched; instruments write up to 30 before it."""
_COMMENTS = ("#", "%")
_NUMBER = re.compile(r"\s*[-+]?(?:[0-9]+(?:[.,][0-9]*)?|[.,][0-9]+)(?:[eE][-+]?[0-9]+)?\s*")

_LATIN_1 = "tactile_localizer.latin_1"
"""Error handler of a decoder that takes for Latin-1 what is not in the encoding, as of older programs."""


def _decode_latin_1(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeDecodeError)
    return error.object[error.start : error.end].decode("latin-1"), error.end


codecs.register_error(_LATIN_1, _decode_latin_1)


class Header(NamedTuple):
    """Names of the columns, the separator between them, and the number of their line."""

    names: list[str]
    separator: str = ","
    line: int = 0


def read_rows(path: Path, wanted: Collection[str] = ()) -> tuple[Header, Iterator[tuple[int, list[str]]]]:
    """The header of a file, and the line number and cells of each row behind it.

    The header is the first line that has the ``wanted`` columns, or most of them; it may be a comment. The
    separator is that with which it has them: comma, semicolon, tab, bar or blanks. Skipped are lines of text
    behind it (units), blank lines, repetitions of the header, and lines that begin with ``#`` or ``%``. The
    text is UTF-8 or UTF-16 (with a byte order mark), what is not is Latin-1; gzip may compress it.

    Raises
    ------
    ScanError
        The file cannot be read, is no text, or is too large; or, from the rows, one has more cells than the
        header.
    """
    rows = _rows(path, wanted)
    return next(rows), rows


def _rows(path: Path, wanted: Collection[str]) -> Iterator[Any]:
    kinds = OSError, EOFError, zlib.error, ValueError, csv.Error
    with refusing(f"{path}: expected a CSV file", ScanError, *kinds), open_file(path) as stored:
        lines, size = _lines(path, stored)
        head = [next(lines, "")]
        while head[-1] and len(head) < _HEAD and len("".join(head)) < _MAX_LINE:
            head.append(next(lines, ""))
        header = _header(head, wanted)
        yield header
        most = _MOST_NUMBERS // max(len(wanted), 1)
        expected = size * len(head) // max(len("".join(head)), 1)
        width, names, is_units = len(header.names), head[max(header.line - 1, 0)], True
        for number, line in enumerate(chain(head[header.line :], lines), header.line + 1):
            if (found := max(number, expected)) > most:
                raise ScanError(
                    f"{path}: expected at most {most} rows, found {found}, or a file that is cut short; "
                    "split it by sweeps"
                )
            if line.isspace() or line.startswith(_COMMENTS) or line == names or not line:
                continue
            cells = _cells(line, header.separator)
            is_units = is_units and not any(map(_NUMBER.fullmatch, cells))
            if is_units:
                continue
            if len(cells) > width and any(map(str.strip, cells[width:])):
                raise ScanError(
                    f"{path} line {number}: expected {width} cells as in the header, found {len(cells)} "
                    "(decimal commas? write points, or separate by semicolons)"
                )
            yield number, cells


def _lines(path: Path, stored: BinaryIO) -> tuple[Iterator[str], int]:
    """Lines of a file, and its uncompressed size in bytes, which gzip has modulo 2**32."""
    size = os.fstat(stored.fileno()).st_size
    content: Any = stored
    if stored.read(2) == b"\x1f\x8b":
        content = gzip.GzipFile(fileobj=stored)
        stored.seek(max(size - 4, 0))
        size = int.from_bytes(stored.read(4), "little")
    stored.seek(0)
    start = content.peek(256)[:256]
    is_utf_16 = start.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    if b"\0" in start and not is_utf_16:
        advice = "a spreadsheet? export it; compressed? gzip is read"
        raise ScanError(f"{path}: expected a CSV file, found one that is no text ({advice})")
    encoding = "utf-16" if is_utf_16 else "utf-8-sig"
    text = io.TextIOWrapper(content, encoding, _LATIN_1, newline="")

    def lines() -> Iterator[str]:
        while line := text.readline(_MAX_LINE):
            if len(line) == _MAX_LINE:
                raise ScanError(f"{path}: expected lines of less than {_MAX_LINE} characters")
            yield line

    return lines(), size


def _header(head: list[str], wanted: Collection[str]) -> Header:
    """The line with most of the ``wanted`` columns; of equal ones that which looks most like a header."""
    known, found = set(wanted), Header([])
    best: tuple[int, ...] = ()
    last = next((line for line in reversed(head) if line.strip()), "")
    for separator in (",", ";", "\t", "|", " "):
        width = len(_cells(last, separator)) if separator in last else 1
        for number, line in enumerate(head, 1):
            if not line.strip() or (separator not in line and separator != ","):
                continue
            names = [name.strip() for name in _cells(line.lstrip("#% "), separator)]
            score = (
                len(known & {*names}),
                not any(map(_NUMBER.fullmatch, names)),
                len(names) == width,
                separator != " ",
                len(names),
                not line.startswith(_COMMENTS),
            )
            if score > best:
                best, found = score, Header(names, separator, number)
    return found


def _cells(line: str, separator: str) -> list[str]:
    if '"' not in line:  # several times faster than a reader
        return line.split(None if separator == " " else separator)
    return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
