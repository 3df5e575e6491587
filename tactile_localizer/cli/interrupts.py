"""Commands that have started processes end them, whichever way they are ended themselves."""

from __future__ import annotations

import signal
from types import FrameType


def end_as_by_interrupt() -> None:
    """From now on SIGTERM and the terminal closing end this process as Ctrl-C does, save under ``nohup``."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt
