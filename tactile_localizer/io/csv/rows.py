"""Rows of a table in a text file: compression, encoding, separator and header are found in the file."""

import codecs
import csv
import gzip
import io
import os
import re
import zlib
from collections.abc import Collection, Iterator, Sequence
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
_SEPARATORS = (",", ";", "\t", "|", " ")
MISSING = ("", "-", "na", "n/a", "#n/a", "<na>", "none", "null", "nan")
"""Spellings of a missing value, in lower case."""
_BY_NUMBER = re.compile(r"column([1-9][0-9]{0,5})")
NUMBER = re.compile(r"\s*[-+]?(?:[0-9]+(?:[.,][0-9]*)?|[.,][0-9]+)(?:[eE][-+]?[0-9]+)?\s*")

_LATIN_1 = "tactile_localizer.latin_1"
"""Error handler of a decoder that takes for Latin-1 what is not in the encoding, as of older programs."""


def _decode_latin_1(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeDecodeError)
    return error.object[error.start : error.end].decode("latin-1"), error.end


codecs.register_error(_LATIN_1, _decode_latin_1)


class Header(NamedTuple):
    """Columns of a file.

    Parameters
    ----------
    names : of the columns; ``column1``, ``column2``, ... where the file has none
    separator : between the cells
    line : number of the line with the names, or of that before the first row; 0 where this is the first line
    first : cells of the first row of a file without names; else empty
    """

    names: list[str]
    separator: str = ","
    line: int = 0
    first: Sequence[str] = ()

    def place(self, name: str) -> int | None:
        """Place of a column, from 0, by its name or, as ``column1``, its number; ``None`` without one."""
        if name in self.names:
            return self.names.index(name)
        by_number = _BY_NUMBER.fullmatch(name)
        return int(by_number[1]) - 1 if by_number and int(by_number[1]) <= len(self.names) else None


class Block(NamedTuple):
    """Lines of a file behind its header.

    Parameters
    ----------
    lines : their numbers
    text : the lines, each with its end
    """

    lines: range
    text: str

    @property
    def has_comments(self) -> bool:
        """Whether there may be comments."""
        return any(mark in self.text for mark in _COMMENTS)

    def rows(self) -> dict[int, str]:
        """Rows by their lines; blank lines and comments are none."""
        lines = zip(self.lines, self.text.split("\n"), strict=False)
        return {at: line for at, line in lines if line.strip() and not line.startswith(_COMMENTS)}


def read_rows(path: Path, wanted: Collection[str] = ()) -> tuple[Header, Iterator[Block]]:
    """The header of a file, and the lines behind it, by the thousand.

    The header is the first line that has the ``wanted`` columns, or most of them; it may be a comment. The
    separator is that with which it has them: comma, semicolon, tab, bar or blanks. Skipped are lines of text
    directly behind it (units), blank lines, repetitions of the header, and lines that begin with ``#`` or
    ``%``. The text is UTF-8 or UTF-16 (with a byte order mark), what is not is Latin-1; gzip may compress it.
    A file of numbers alone has no header.

    Raises
    ------
    ScanError
        The file cannot be read, is no text, or is too large.
    """
    rows = _rows(path, wanted)
    return next(rows), rows


def _rows(path: Path, wanted: Collection[str]) -> Iterator[Any]:
    kinds = OSError, EOFError, zlib.error, ValueError
    with refusing(f"{path}: expected a CSV file", ScanError, *kinds), open_file(path) as stored:
        blocks, size = _blocks(path, stored)
        head = next(blocks, "")
        lines = head.split("\n")
        header = _header(lines[:_HEAD], wanted)
        yield header
        most = _MOST_NUMBERS // max(len(wanted), 1)
        expected = size * len(lines) // max(len(head), 1)
        first, behind = header.line + 1, lines[header.line :]
        while len(behind) > 1 and not any(map(NUMBER.fullmatch, cells_of(behind[0], header.separator))):
            first, behind = first + 1, behind[1:]  # units
        for text in chain(["\n".join(behind)], blocks):
            numbers = range(first, first + text.count("\n"))
            first = numbers.stop
            if (found := max(first - 1, expected)) > most:
                raise ScanError(
                    f"{path}: expected at most {most} rows, found {found}, or a file that is cut short; "
                    "split it by sweeps"
                )
            if not text.isspace():
                yield Block(numbers, text)


def _blocks(path: Path, stored: BinaryIO) -> tuple[Iterator[str], int]:
    """Lines of a file, many in a text, and its uncompressed size in bytes, which gzip has modulo 2**32."""
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
    text = io.TextIOWrapper(content, "utf-16" if is_utf_16 else "utf-8-sig", _LATIN_1)

    def blocks() -> Iterator[str]:
        rest = ""
        while block := text.read(_MAX_LINE):
            lines, end, rest = (rest + block).rpartition("\n")
            if len(rest) >= _MAX_LINE:
                raise ScanError(f"{path}: expected lines of less than {_MAX_LINE} characters")
            if end:
                yield lines + end
        if rest:
            yield rest + "\n"

    return blocks(), size


def _header(head: list[str], wanted: Collection[str]) -> Header:
    """The line with most of the ``wanted`` columns; of equal ones that which looks most like a header."""
    known, found = set(wanted), Header([])
    best: tuple[int, ...] = ()
    last = next((line for line in reversed(head) if line.strip()), "")
    for separator in _SEPARATORS:
        width = len(cells_of(last, separator)) if separator in last else 1
        for number, line in enumerate(head, 1):
            if not line.strip() or (separator not in line and separator != ","):
                continue
            names = [name.strip() for name in cells_of(line.lstrip("#% "), separator)]
            score = (
                len(known & {*names}),
                not any(map(NUMBER.fullmatch, names)) or _are_counted(names),
                len(names) == width,
                separator != " ",
                len(names),
                not line.startswith(_COMMENTS),
            )
            if score > best:
                best, found = score, Header(names, separator, number)
    is_header = best[:1] > (0,) or _are_counted(found.names) or _is_above(found, last)
    return found if is_header else _without_names(head, last) or found


def _is_above(header: Header, last: str) -> bool:
    """Whether a header has a name for each cell of the last line, and text where that has a number."""
    cells = cells_of(last.rstrip(header.separator + " "), header.separator)
    are_text = [any(map(str.isalpha, name)) and name.lower() not in MISSING for name in header.names]
    are_numbers = map(NUMBER.fullmatch, cells)
    return len(cells) <= len(header.names) and any(map(all, zip(are_text, are_numbers, strict=False)))


def _are_counted(names: Sequence[str]) -> bool:
    """Whether columns are numbered from 0, as pandas writes those of an array."""
    named = names[names[:1] == [""] :]
    return len(named) > 1 and named == [str(number) for number in range(len(named))]


def _without_names(head: list[str], last: str) -> Header | None:
    """The columns by their numbers, if the lines are numbers; the separator is that between most of them."""

    def numbers(separator: str) -> int:
        cells = cells_of(last, separator)
        return 2 * sum(map(bool, map(NUMBER.fullmatch, cells))) - len(cells)

    separator = max(_SEPARATORS, key=numbers)
    width = len(cells_of(last, separator))
    for number, line in enumerate(head):
        cells = cells_of(line, separator)
        if len(cells) == width and any(map(NUMBER.fullmatch, cells)) and not line.startswith(_COMMENTS):
            return Header([f"column{each}" for each in range(1, width + 1)], separator, number, cells)
    return None


def cells_of(line: str, separator: str) -> list[str]:
    """The cells of a line, of which some may be in quotes.

    Raises
    ------
    ValueError
        One is too long.
    """
    if '"' not in line:  # several times faster than a reader
        return line.split(None if separator == " " else separator)
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error as error:
        raise ValueError(str(error)) from None
