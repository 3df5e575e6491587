"""Rows of CSV files in common dialects: commas, semicolons or tabs, decimal commas, comments, gzip."""

from __future__ import annotations

import csv
import gzip
import io
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import TextIO

from tactile_localizer.errors import ScanError

_MAX_LINE_CHARACTERS = 1 << 25
"""Longest line that is read: a million columns, but not a whole binary file without line ends."""

_MAX_LISTED_NAMES, _MAX_NAME_CHARACTERS = 20, 40
"""Most names listed in a message, and most characters of each."""

_UTF_16_MARKS = (b"\xff\xfe", b"\xfe\xff")


def read_table(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of each row, header first; blank lines and lines that begin with # are skipped.

    The delimiter is the most frequent one in the header: comma, semicolon or tab. Unless it is the comma,
    a comma in a cell is a decimal comma. The file may be compressed with gzip.

    Raises
    ------
    ScanError
        The file cannot be read, is not UTF-8 text, or has a row with more cells than the header.
    """
    try:
        with _opened(path) as file:
            lines = _lines(path, file)
            skipped, header = 0, next(lines, "")
            while header and (header.isspace() or header.startswith("#")):
                skipped += 1
                header = next(lines, "")
            delimiter = max(",;\t", key=header.count)
            reader = csv.reader(chain([header], lines), delimiter=delimiter, skipinitialspace=True)
            width = 0
            for cells in reader:
                if cells and not cells[0].startswith("#"):
                    width = width or len(cells)
                    if len(cells) > width and any(map(str.strip, cells[width:])):
                        raise _too_wide(path, skipped + reader.line_num, width, len(cells), delimiter)
                    decimal = cells if delimiter == "," else [cell.replace(",", ".") for cell in cells]
                    yield skipped + reader.line_num, decimal
    except UnicodeDecodeError:
        raise ScanError(f"{path}: expected a CSV file in UTF-8, found other bytes") from None
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise ScanError(f"{path}: expected a CSV file in gzip, {error}") from None
    except (OSError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise ScanError(f"{path}: expected a CSV file, {reason}") from None


def listed(names: Sequence[str]) -> str:
    """Column names for a message, cut to a reasonable number and length."""
    shown = [" ".join(name.split())[:_MAX_NAME_CHARACTERS] for name in names[:_MAX_LISTED_NAMES]]
    more = len(names) - _MAX_LISTED_NAMES
    rest = f" and {more} more" if more > 0 else ""
    return ", ".join(shown) + rest


@contextmanager
def _opened(path: Path) -> Iterator[TextIO]:
    with path.open("rb") as stored:
        is_gzip = stored.peek(2)[:2] == b"\x1f\x8b"
        raw = gzip.GzipFile(fileobj=stored) if is_gzip else stored
        if raw.peek(2)[:2] in _UTF_16_MARKS:
            raise ScanError(f"{path}: expected text in UTF-8, found UTF-16; save it as UTF-8")
        with io.TextIOWrapper(raw, encoding="utf-8-sig", newline="") as file:
            yield file


def _lines(path: Path, file: TextIO) -> Iterator[str]:
    while line := file.readline(_MAX_LINE_CHARACTERS):
        if len(line) == _MAX_LINE_CHARACTERS:
            raise ScanError(
                f"{path}: expected a CSV file, found a line of over {_MAX_LINE_CHARACTERS} characters"
            )
        yield line


def _too_wide(path: Path, line: int, width: int, found: int, delimiter: str) -> ScanError:
    hint = " (decimal commas? separate the columns by semicolons)" if delimiter == "," else ""
    return ScanError(f"{path} line {line}: expected {width} cells as in the header, found {found}{hint}")
