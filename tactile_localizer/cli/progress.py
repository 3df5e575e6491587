"""Progress on standard error: one line that is rewritten on a terminal, now and then a line elsewhere."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

LINE_EVERY_S = 10.0
"""Time between two lines where standard error is no terminal, s."""

_ERASED = "\r\x1b[K"
"""The begin of a terminal's line, which is erased."""


@contextmanager
def progress_line() -> Iterator[Callable[[str, float], None]]:
    """Context with a function that shows a description of the work and its completed fraction.

    At the end a terminal's line is erased. Elsewhere, short commands print none.
    """
    begin, end, every_s = (_ERASED, "", 0.0) if sys.stderr.isatty() else ("", "\n", LINE_EVERY_S)
    shown_s = time.monotonic()

    def show(text: str, fraction: float) -> None:
        nonlocal shown_s
        if time.monotonic() - shown_s >= every_s:
            shown_s = time.monotonic()
            print(f"{begin}{text}: {fraction:.0%}", end=end, file=sys.stderr, flush=True)

    try:
        yield show
    finally:
        print(begin, end="", file=sys.stderr, flush=True)
