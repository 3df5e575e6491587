"""Progress on standard error: bars on a terminal, now and then a line elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec

LINE_EVERY_S = 10.0
"""Time between two lines where standard error is no terminal or rich is not installed, s."""


@contextmanager
def progress_bars() -> Iterator[Callable[[str, float], None]]:
    """Context with a function that shows a description of the work and its completed fraction."""
    if not sys.stderr.isatty() or find_spec("rich") is None:
        yield _lines()
        return
    from rich.console import Console
    from rich.progress import Progress, TaskID  # a slow import, needed on a terminal only

    with Progress(console=Console(stderr=True), transient=True) as progress:
        tasks: dict[str, TaskID] = {}

        def show(text: str, fraction: float) -> None:
            if text not in tasks:
                tasks[text] = progress.add_task(text, total=1.0)
            progress.update(tasks[text], completed=fraction)

        yield show


def _lines() -> Callable[[str, float], None]:
    """A function that prints a line at most every :data:`LINE_EVERY_S`, so that short commands print none."""
    printed_s = time.monotonic()

    def show(text: str, fraction: float) -> None:
        nonlocal printed_s
        if time.monotonic() - printed_s >= LINE_EVERY_S:
            printed_s = time.monotonic()
            print(f"{text}: {fraction:.0%}", file=sys.stderr, flush=True)

    return show
