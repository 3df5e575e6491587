"""Printing of tables to the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.box import SIMPLE
from rich.console import Console
from rich.table import Table

_WIDTH = 250
"""Largest width, characters: rows of numbers are not wrapped to the terminal."""


def print_table(
    title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], note: str = "", *, text: bool = False
) -> None:
    """Print rows of texts under column headings, with a note that explains the columns.

    Parameters
    ----------
    title, columns, rows, note : texts, which are printed literally
    text : whether the columns are text; otherwise those after the first are numbers, aligned to the right
    """
    table = Table(title=title, title_justify="left", box=SIMPLE)
    for number, name in enumerate(columns):
        table.add_column(name, justify="left" if text or number == 0 else "right")
    for row in rows:
        table.add_row(*row)
    console = Console(markup=False, emoji=False, highlight=False, soft_wrap=True, width=_WIDTH)
    console.print(table)
    if note:
        console.print(f" {note}\n")
