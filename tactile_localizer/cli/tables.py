"""Printing of tables to the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill

_WIDTH = 80
"""Length of a note's lines, characters."""


def print_table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], note: str = "", *, text: bool = False
) -> None:
    """Print rows of texts under column headings, with a note that explains the columns.

    Parameters
    ----------
    columns, rows, note : texts
    text : whether the columns are text; otherwise those after the first are numbers, aligned to the right
    """
    widths = [max(map(len, column)) for column in zip(columns, *rows, strict=True)]
    for row in (columns, *rows):
        cells = [
            cell.ljust(width) if text or not number else cell.rjust(width)
            for number, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        print("  ".join(cells).rstrip())
    if note:
        print(f"\n{fill(note, _WIDTH)}")
