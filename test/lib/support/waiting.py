"""Waiting for a condition with a deadline; without CPU time a missed one raises :class:`StarvedError`."""

import contextlib
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")

PATIENCE_S = 90.0
"""Time limit for what takes a moment on an idle machine, s: only a test that fails waits as long."""
_STARVED_FRACTION = 0.25
"""Fraction of a timeout spent waiting for a CPU above which a missed deadline is blamed on the machine."""


class StarvedError(AssertionError):
    """A deadline was missed while this process, or one that it started, had to wait for a CPU."""


class Deadline:
    """A time limit.

    Parameters
    ----------
    what : what is waited for; completes the sentence "waited 15 s for ...", when the limit has passed
    timeout_s : time limit, s
    """

    def __init__(self, what: object, timeout_s: float) -> None:
        self._what, self._timeout_s = what, timeout_s
        self._start_s = time.monotonic()
        self._cpu_waits = cpu_waits_s()

    def check(self) -> None:
        """Fail if the limit has passed.

        Raises
        ------
        StarvedError
            The processes had to wait for a CPU during a large part of the time.
        AssertionError
            They did not.
        """
        if time.monotonic() - self._start_s > self._timeout_s:
            raise self.failure()

    def failure(self) -> AssertionError:
        """The error of a missed deadline."""
        text = f"waited {self._timeout_s:g} s for {self._what}"
        starved_s = max(waited - self._cpu_waits.get(pid, 0.0) for pid, waited in cpu_waits_s().items())
        if starved_s > _STARVED_FRACTION * self._timeout_s:
            return StarvedError(f"{text}; a process waited {starved_s:.1f} s of them for a CPU")
        return AssertionError(text)


def cpu_waits_s() -> dict[int, float]:
    """Time that this process and its descendants have waited for a CPU, by process id, s: longest thread."""
    return {pid: max(map(_run_delay_s, _of_threads(pid, "schedstat")), default=0.0) for pid in _family()}


def wait_until(condition: Callable[[], T], what: str, timeout_s: float = PATIENCE_S) -> T:
    """The first true value of ``condition``; fails the test if there is none in time."""
    deadline = Deadline(what, timeout_s)
    while not (value := condition()):
        deadline.check()
        time.sleep(0.01)
    return value


def children(pid: int) -> list[int]:
    """Processes that ``pid`` has started and that still run."""
    found: list[int] = []
    for file in _of_threads(pid, "children"):
        with contextlib.suppress(OSError):  # the thread has ended
            found += map(int, file.read_text().split())
    return found


def has_ended(pid: int) -> bool:
    """Whether a process has ended, also if nobody has asked for its exit status."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except FileNotFoundError:
        return True


def wait_for_import(pid: int, package: str) -> None:
    """Wait until a process has loaded a compiled module of a Python package."""
    wait_until(lambda: f"/{package}/" in Path(f"/proc/{pid}/maps").read_text(), f"import {package}")


def _family() -> list[int]:
    """This process and its descendants."""
    family = [os.getpid()]
    for pid in family:
        family += children(pid)
    return family


def _of_threads(pid: int, name: str) -> list[Path]:
    """The files of that name of each thread of a process; none where it has ended."""
    try:
        return list(Path(f"/proc/{pid}/task").glob(f"*/{name}"))
    except FileNotFoundError:
        return []


def _run_delay_s(schedstat: Path) -> float:
    try:
        return int(schedstat.read_text().split()[1]) * 1e-9
    except (OSError, IndexError):  # the thread has ended
        return 0.0
