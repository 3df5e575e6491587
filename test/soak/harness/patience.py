"""How long is waited for processes: what the machine takes from them is no fault of theirs."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterable
from pathlib import Path

_MOST = 2.0
"""Most that a wait may grow by, in shares of its length."""


def starved_s(pid: int) -> float:
    """How long a process has waited for a processor since it began, s: the thread that did so longest."""
    waited_ns = [0]
    for file in Path(f"/proc/{pid}/task").glob("*/schedstat"):
        with contextlib.suppress(OSError):  # the thread has ended
            waited_ns.append(int(file.read_text().split()[1]))
    return max(waited_ns) * 1e-9


class Patience:
    """A time limit that does not count the time for which a process waited for a processor.

    Parameters
    ----------
    limit_s : how long is waited where they all have one; three times as long at most
    pids : the processes; the one that has waited longest counts
    """

    def __init__(self, limit_s: float, pids: Iterable[int]) -> None:
        self._limit_s = limit_s
        self._begun_s = time.monotonic()
        self._starved_s = {pid: starved_s(pid) for pid in pids}

    @property
    def is_late(self) -> bool:
        """Whether the limit has passed, were all time counted."""
        return self._late_s > 0

    @property
    def is_over(self) -> bool:
        """Whether it has been waited long enough."""
        return self.is_late and self._late_s > min(self._taken_s(), _MOST * self._limit_s)

    @property
    def _late_s(self) -> float:
        return time.monotonic() - self._begun_s - self._limit_s

    def _taken_s(self) -> float:
        return max((starved_s(pid) - before_s for pid, before_s in self._starved_s.items()), default=0.0)
