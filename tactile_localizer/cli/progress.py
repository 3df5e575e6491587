"""Progress on standard error: bars on a terminal, now and then a line elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec

LINE_EVERY_S = 10.0
"""Time between two lines where standard error is no terminal, s."""


@contextmanager
def progress_bars() -> Iterator[Callable[[str, float], None]]:
    """Context with a function that shows a description of the work and its completed fraction."""
    if not sys.stderr.isatty() or find_spec("rich") is None:
        yield _Lines()
        return
    # These slow imports are needed on a terminal only.
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TaskID,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True, markup=False, emoji=False)
    with Progress(*columns, console=console, transient=True) as progress:
        tasks: dict[str, TaskID] = {}

        def show(text: str, fraction: float) -> None:
            if text not in tasks:
                tasks[text] = progress.add_task(text, total=1.0)
            progress.update(tasks[text], completed=fraction)

        yield show


class _Lines:
    """Prints a line at most every :data:`LINE_EVERY_S`, so that short commands print none."""

    def __init__(self) -> None:
        self._printed_s = time.monotonic()

    def __call__(self, text: str, fraction: float) -> None:
        if time.monotonic() - self._printed_s >= LINE_EVERY_S:
            self._printed_s = time.monotonic()
            print(f"{text}: {fraction:.0%}", file=sys.stderr, flush=True)
