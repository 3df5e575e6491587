"""Tables of evaluations on a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.box import SIMPLE
from rich.console import Console
from rich.markup import escape
from rich.table import Table as Shown

from tactile_localizer.offline.reports.table import Table

_WORDS = 60
"""Characters from which a cell is words rather than a number."""

_WIDEST = 250
"""Characters of a line of numbers, whatever the terminal's width."""


def print_tables(tables: Sequence[Table]) -> None:
    """Print tables: numbers as wide as they are, words within the terminal."""
    terminal = Console(highlight=False, soft_wrap=True)
    for table in tables:
        words = [any(len(row[column]) > _WORDS for row in table.rows) for column in range(len(table.columns))]
        shown = Shown(title=escape(table.title), title_justify="left", box=SIMPLE)
        for number, name in enumerate(table.columns):
            shown.add_column(escape(name), justify="left" if words[number] or number == 0 else "right")
        for row in table.rows:
            shown.add_row(*map(escape, row))
        console = terminal if any(words) else Console(highlight=False, soft_wrap=True, width=_WIDEST)
        console.print(shown)
        if table.note:
            terminal.print(f" {escape(table.note)}\n")
