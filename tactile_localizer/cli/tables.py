"""Printing of tables to the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table


def print_table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], note: str = "", *, text: bool = False
) -> None:
    """Print rows of texts under column headings, with a note that explains the columns.

    Parameters
    ----------
    columns, rows, note : texts, which are printed literally
    text : whether the columns are text; otherwise those after the first are numbers, aligned to the right
    """
    table = Table(box=None, padding=(0, 2, 0, 0))
    for number, name in enumerate(columns):
        table.add_column(name, justify="left" if text or number == 0 else "right", no_wrap=not text)
    for row in rows:
        table.add_row(*row)
    console = Console(markup=False, emoji=False, highlight=False)
    console.print(table)
    if note:
        console.print(note)
