"""From ``tactile-localizer replay`` to the first estimate: of a scan of 16,321 pairs without parameters.

The command replays two strains, so it lasts hardly longer than until the first estimate; imports count. Once
with a scan file from which nothing was learned before, then with what was learned stored in it, and with
threads of BLAS as the environment leaves them (``OMP_NUM_THREADS`` unset) beside one.

Run by ``make bench``, or alone: ``scripts/in_env python benchmarks/first_estimate.py [--runs 3]``.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from record import record, row
from workload import PAIRS, bump_scan, bump_scene

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.scene import Scene
from tactile_localizer.sim import simulate_scan

_COMMAND = "from tactile_localizer.cli import main; raise SystemExit(main())"
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def store(path: Path, scan: Scan, scene: Scene) -> None:
    """A scan file from which nothing was learned."""
    with ScanStore.create(path, scene) as file:
        for number in scan.sweep_numbers:
            own = scan.sweep == number
            file.begin_sweep()
            file.append(np.arange(np.count_nonzero(own)) * 10_000_000, scan.states[own], scan.strain[own])
            file.end_sweep()


def two_strains(path: Path) -> None:
    """A recording of two strains, as CSV."""
    test = simulate_scan("bump", 1, "test", sweeps=1)
    names = [f"{finger}_{gauge}" for finger in ("index", "middle") for gauge in range(1, 9)]
    rows = [",".join(("stamp_s", "x", "y", *names))]
    for n in range(2):
        values = (test.stamp_ns[n] * 1e-9, *test.odometry[n], *test.strain[n])
        rows.append(",".join(f"{value:.9g}" for value in values))
    path.write_text("\n".join(rows) + "\n")


def replay(folder: Path, environment: Mapping[str, str]) -> tuple[float, float]:
    """Time and processor time of the command, s."""
    command = [sys.executable, "-c", _COMMAND, "replay", "two.csv", "--scan", "scan.db"]
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, cwd=folder, env=dict(environment), check=True, stdout=subprocess.DEVNULL)
    taken, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    return taken, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measure(runs: int) -> list[dict[str, Any]]:
    """Medians over some runs, interleaved."""
    free = {name: value for name, value in os.environ.items() if name not in _THREADS}
    one = free | dict.fromkeys(_THREADS, "1")
    times: dict[str, list[tuple[float, float]]] = {}
    for _ in range(runs):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            store(folder / "scan.db", bump_scan(), replace(bump_scene(), measurement={}))
            two_strains(folder / "two.csv")
            for title, environment in (
                ("nothing learned", free),
                ("learned before", free),
                ("learned before, one thread asked for", one),
            ):
                times.setdefault(title, []).append(replay(folder, environment))
    limits = {"nothing learned": "<= 5", "learned before": "<= 1"}
    rows = []
    for title, taken in times.items():
        wall_s, cpu_s = np.median(np.array(taken), axis=0)
        name = f"first estimate, {title}"
        rows.append(row(name, wall_s, "s", limits.get(title), pairs=PAIRS, cpu_s=float(cpu_s)))
        rows.append(row(f"{name}: processor time", cpu_s, "s"))
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    record(measure(parser.parse_args().runs))
