"""Termination signals handled as interrupts, so that a command ends the processes it started."""

from __future__ import annotations

import signal
from types import FrameType


def end_as_by_interrupt() -> None:
    """Make SIGTERM and SIGHUP raise :class:`KeyboardInterrupt`, unless ignored (``nohup``)."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt
