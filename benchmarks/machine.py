"""Scheduling latency of the machine during a measurement: how late it wakes a process that only sleeps.

One process per core sleeps 1 ms at a time, at real-time priority if permitted. Its delays are caused by the
machine or its host, not by the measured nodes.
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
_REPORTED_NS = 1_000_000
_PRIORITY = 50
_READY = b"\n"


class Machine:
    """Context that measures the delays of sleeping processes.

    Attributes
    ----------
    late : (n, 2) after the block: due time of each sleep that ended more than 1 ms late, ns of the system
        clock, and its delay, ms
    stolen_s : after the block: time for which the host did not run the cores although they had work, s
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
        written = b"".join(sleeper.communicate(timeout=10)[0] for sleeper in self._sleepers)
        pairs = np.frombuffer(written, dtype=np.int64).reshape(-1, 2)
        self.late = pairs * [1.0, 1e-6]
        self.stolen_s = _stolen_s() - self._stolen_s

    def during(self, begin_ns: int, end_ns: int) -> float:
        """Longest delay of a sleep that was due between two times, ms."""
        inside = (self.late[:, 0] >= begin_ns) & (self.late[:, 0] <= end_ns)
        return float(self.late[inside, 1].max(initial=0.0))


def _stolen_s() -> float:
    return int(Path("/proc/stat").read_text().split()[8]) / os.sysconf("SC_CLK_TCK")


def sleep(core: int) -> None:
    """Sleep on a core until interrupted; then write the delays to standard output."""
    late = array("q")
    os.sched_setaffinity(0, {core})
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    except PermissionError:
        print(
            f"core {core}: no real-time priority, so delays include waiting for other processes",
            file=sys.stderr,
        )
    sys.stdout.buffer.write(_READY)
    sys.stdout.buffer.flush()
    try:
        while True:
            due_ns = time.time_ns() + round(_SLEEP_S * 1e9)
            time.sleep(_SLEEP_S)
            late_ns = time.time_ns() - due_ns
            if late_ns > _REPORTED_NS:
                late.extend((due_ns, late_ns))
    except KeyboardInterrupt:
        sys.stdout.buffer.write(late.tobytes())
