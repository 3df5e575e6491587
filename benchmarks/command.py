"""Measure the elapsed time, CPU time and peak memory of a ``tactile-localizer`` command."""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

_COMMAND = """
import sys
from tactile_localizer.cli import main
status = main()
print(open("/proc/self/status").read().partition("VmHWM:")[2].split()[0], file=sys.stderr)
raise SystemExit(status)
"""
"""Also prints the peak memory, kB; ru_maxrss would include that of the parent."""


class Cost(NamedTuple):
    """Elapsed and processor time of a command, s, and its peak memory, MB."""

    wall_s: float
    cpu_s: float
    peak_mb: float


def run_command(arguments: Sequence[str], folder: Path, environment: Mapping[str, str]) -> Cost:
    """Run ``tactile-localizer`` with ``arguments`` in ``folder``."""
    command = [sys.executable, "-c", _COMMAND, *arguments]
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(
        command, cwd=folder, env=dict(environment), check=True, capture_output=True, text=True
    )
    wall_s, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Cost(wall_s, cpu_s, float(done.stderr.split()[-1]) / 1e3)
