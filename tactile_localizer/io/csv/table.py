"""Rows of a CSV file as people write them: commas, semicolons or tabs, decimal commas, comments, gzip."""

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

_LONGEST_LINE = 1 << 25
"""Characters of a line that are read: a million columns, and no file without line ends as a whole."""
_SHOWN, _LONGEST_NAME = 20, 40
"""Names that a message lists at most, and characters of each."""
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")


def read_table(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of each row, the header first, without blank lines and those that begin with #.

    Columns are separated by what the header has most of: commas, semicolons or tabs. Where it is not commas,
    a comma in a cell is that of a decimal fraction. A file may be compressed with gzip.

    Raises
    ------
    ScanError
        The file cannot be read, is not text in UTF-8, or has a row with more cells than the header.
    """
    try:
        with _opened(path) as file:
            lines = _lines(path, file)
            before, header = 0, next(lines, "")
            while header and (header.isspace() or header.startswith("#")):
                before += 1
                header = next(lines, "")
            delimiter = max(",;\t", key=header.count)
            reader = csv.reader(chain([header], lines), delimiter=delimiter, skipinitialspace=True)
            width = 0
            for cells in reader:
                if cells and not cells[0].startswith("#"):
                    width = width or len(cells)
                    if len(cells) > width and any(map(str.strip, cells[width:])):
                        raise _too_wide(path, before + reader.line_num, width, len(cells), delimiter)
                    decimal = cells if delimiter == "," else [cell.replace(",", ".") for cell in cells]
                    yield before + reader.line_num, decimal
    except UnicodeDecodeError:
        raise ScanError(f"{path}: expected a CSV file, not text in UTF-8") from None
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise ScanError(f"{path}: expected a CSV file in gzip, {error}") from None
    except (OSError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise ScanError(f"{path}: expected a CSV file, {reason}") from None


def listed(names: Sequence[str]) -> str:
    """Names of columns in one line of a message: the first of many, each cut where it is long."""
    shown = [" ".join(name.split())[:_LONGEST_NAME] for name in names[:_SHOWN]]
    rest = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(shown) + rest


@contextmanager
def _opened(path: Path) -> Iterator[TextIO]:
    with path.open("rb") as stored:
        is_gzip = stored.peek(2)[:2] == b"\x1f\x8b"
        raw = gzip.GzipFile(fileobj=stored) if is_gzip else stored
        if raw.peek(2)[:2] in _UTF_16:
            raise ScanError(f"{path}: expected text in UTF-8, found UTF-16; save it as UTF-8")
        with io.TextIOWrapper(raw, encoding="utf-8-sig", newline="") as file:
            yield file


def _lines(path: Path, file: TextIO) -> Iterator[str]:
    while line := file.readline(_LONGEST_LINE):
        if len(line) == _LONGEST_LINE:
            raise ScanError(f"{path}: expected a CSV file, found a line of over {_LONGEST_LINE} characters")
        yield line


def _too_wide(path: Path, line: int, width: int, found: int, delimiter: str) -> ScanError:
    hint = " (decimal commas? separate the columns by semicolons)" if delimiter == "," else ""
    return ScanError(f"{path} line {line}: expected {width} cells as in the header, found {found}{hint}")
