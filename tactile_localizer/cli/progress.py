"""Progress bars on a terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console


@contextmanager
def progress_bars() -> Iterator[Callable[[str, float], None]]:
    """Context with a function that shows a description of the work and its completed fraction on stderr.

    Nothing is shown where stderr is no terminal.
    """
    console = Console(stderr=True, markup=False, emoji=False)
    if not console.is_terminal:
        yield lambda text, fraction: None
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
