"""Rows of a CSV file as people write them: commas, semicolons or tabs, decimal commas, comments."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from tactile_localizer.errors import ScanError


def read_table(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of each row, the header first, without blank lines and those that begin with #.

    Columns are parted by what the header has most of: commas, semicolons or tabs. Where it is not commas, a
    comma in a cell is that of a decimal fraction.

    Raises
    ------
    ScanError
        The file cannot be read, or is not text.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            before = 0
            header = file.readline()
            while header and (header.isspace() or header.startswith("#")):
                before += 1
                header = file.readline()
            delimiter = max(",;\t", key=header.count)
            reader = csv.reader(chain([header], file), delimiter=delimiter, skipinitialspace=True)
            for cells in reader:
                if cells and not cells[0].startswith("#"):
                    decimal = cells if delimiter == "," else [cell.replace(",", ".") for cell in cells]
                    yield before + reader.line_num, decimal
    except UnicodeDecodeError:
        raise ScanError(f"{path}: expected a CSV file, not text in UTF-8") from None
    except (OSError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise ScanError(f"{path}: expected a CSV file, {reason}") from None
