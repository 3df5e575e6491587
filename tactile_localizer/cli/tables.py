"""Printing of tables to the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.box import SIMPLE
from rich.console import Console
from rich.markup import escape
from rich.table import Table as Shown

from tactile_localizer.offline.table import Table

_TEXT_LENGTH = 60
"""Length above which a cell is wrapped as text."""

_NUMBERS_WIDTH = 250
"""Width of tables without text, which are not wrapped to the terminal."""


def print_tables(tables: Sequence[Table]) -> None:
    """Print tables; only those with text are wrapped to the terminal."""
    terminal = Console(highlight=False, soft_wrap=True)
    for table in tables:
        is_text = [
            any(len(row[column]) > _TEXT_LENGTH for row in table.rows) for column in range(len(table.columns))
        ]
        shown = Shown(title=escape(table.title), title_justify="left", box=SIMPLE)
        for number, name in enumerate(table.columns):
            shown.add_column(escape(name), justify="left" if is_text[number] or number == 0 else "right")
        for row in table.rows:
            shown.add_row(*map(escape, row))
        console = terminal if any(is_text) else Console(highlight=False, soft_wrap=True, width=_NUMBERS_WIDTH)
        console.print(shown)
        if table.note:
            terminal.print(f" {escape(table.note)}\n")
