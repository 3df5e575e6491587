"""What the machine itself does while something is measured: how late it wakes a process that only sleeps.

A process a core, at real-time priority where that is allowed, sleeps 1 ms at a time. What is late then, no
node has delayed: the machine was taken away, or slept.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from array import array
from pathlib import Path

import numpy as np

_SLEEP_S = 1e-3
_TOLD_NS = 1_000_000
_PRIORITY = 50
_READY = b"\n"


class Machine:
    """Watches the machine for as long as its ``with`` block lasts.

    Attributes
    ----------
    late : (n, 2) after the block: when a sleep should have ended, ns of the system's clock, and how much
        later it did, ms; those of more than 1 ms
    stolen_s : after the block: time that the cores wanted and their host gave to others, s
    """

    def __enter__(self) -> Machine:
        self._stolen_s = _stolen_s()
        self._sleepers = [
            subprocess.Popen(
                [sys.executable, "-c", f"from machine import sleep; sleep({core})"],
                cwd=Path(__file__).parent,
                stdout=subprocess.PIPE,
            )
            for core in sorted(os.sched_getaffinity(0))
        ]
        for sleeper in self._sleepers:
            sleeper.stdout.read(len(_READY))  # type: ignore[union-attr]
        return self

    def __exit__(self, *_: object) -> None:
        for sleeper in self._sleepers:
            sleeper.send_signal(signal.SIGINT)
        told = b"".join(sleeper.communicate(timeout=10)[0] for sleeper in self._sleepers)
        pairs = np.frombuffer(told, dtype=np.int64).reshape(-1, 2)
        self.late = pairs * [1.0, 1e-6]
        self.stolen_s = _stolen_s() - self._stolen_s

    def during(self, begin_ns: int, end_ns: int) -> float:
        """Longest lateness of a sleep that should have ended between two times, ms."""
        inside = (self.late[:, 0] >= begin_ns) & (self.late[:, 0] <= end_ns)
        return float(self.late[inside, 1].max(initial=0.0))


def _stolen_s() -> float:
    return int(Path("/proc/stat").read_text().split()[8]) / os.sysconf("SC_CLK_TCK")


def sleep(core: int) -> None:
    """Sleep on a core until interrupted; then write what was late to standard output."""
    late = array("q")
    os.sched_setaffinity(0, {core})
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    except PermissionError:
        print(f"core {core}: sleeps at ordinary priority, and waits for others too", file=sys.stderr)
    sys.stdout.buffer.write(_READY)
    sys.stdout.buffer.flush()
    try:
        while True:
            due_ns = time.time_ns() + round(_SLEEP_S * 1e9)
            time.sleep(_SLEEP_S)
            late_ns = time.time_ns() - due_ns
            if late_ns > _TOLD_NS:
                late.extend((due_ns, late_ns))
    except KeyboardInterrupt:
        sys.stdout.buffer.write(late.tobytes())
