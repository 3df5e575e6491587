"""Time limits for processes that exclude the time in which they wait for a processor."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterable
from pathlib import Path

_MAX_EXTENSION = 2.0
"""Largest extension of a time limit, relative to the limit."""


def starved_s(pid: int) -> float:
    """Time for which a process has waited for a processor since its start, s: maximum over its threads."""
    waited_ns = [0]
    for file in Path(f"/proc/{pid}/task").glob("*/schedstat"):
        with contextlib.suppress(OSError):  # the thread has ended
            waited_ns.append(int(file.read_text().split()[1]))
    return max(waited_ns) * 1e-9


class Patience:
    """A time limit extended by the time for which a process waits for a processor.

    Parameters
    ----------
    limit_s : limit without waiting, s; extended to at most three times as much
    pids : ids of the processes; the longest wait of one of them counts
    """

    def __init__(self, limit_s: float, pids: Iterable[int]) -> None:
        self._limit_s = limit_s
        self._begun_s = time.monotonic()
        self._starved_s = {pid: starved_s(pid) for pid in pids}

    @property
    def is_late(self) -> bool:
        """Whether the limit without extension has passed."""
        return self._late_s > 0

    @property
    def is_over(self) -> bool:
        """Whether the extended limit has passed."""
        return self.is_late and self._late_s > min(self._taken_s(), _MAX_EXTENSION * self._limit_s)

    @property
    def _late_s(self) -> float:
        return time.monotonic() - self._begun_s - self._limit_s

    def _taken_s(self) -> float:
        return max((starved_s(pid) - before_s for pid, before_s in self._starved_s.items()), default=0.0)
