"""Progress display: bars on a terminal, a line every 10 s elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console

_PLAIN_EVERY_S = 10.0


@contextmanager
def progress_bars() -> Iterator[Callable[[str, float], None]]:
    """Context with a function that shows a description of the work and its completed fraction on stderr."""
    console = Console(stderr=True, markup=False, emoji=False)
    if not console.is_terminal:
        yield _plain(console)
        return
    # This slow import is needed on a terminal only.
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
    with Progress(*columns, console=console, transient=True) as progress:
        tasks: dict[str, TaskID] = {}

        def show(text: str, fraction: float) -> None:
            if text not in tasks:
                tasks[text] = progress.add_task(text, total=1.0)
            progress.update(tasks[text], completed=fraction)

        yield show


def _plain(console: Console) -> Callable[[str, float], None]:
    last: dict[str, float] = {}

    def show(text: str, fraction: float) -> None:
        now = time.monotonic()
        # Work that takes less than the interval prints nothing.
        if now - last.setdefault(text, now) >= _PLAIN_EVERY_S:
            last[text] = now
            console.print(f"{text}: {fraction:.0%}", highlight=False, soft_wrap=True)

    return show
