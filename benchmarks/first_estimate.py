"""Time from ``tactile-localizer replay`` to the first estimate, on a scan of 16,321 pairs.

The command replays two samples, so its duration with imports is about the time to the first estimate. It
runs on a scan file without a stored calibration, then on one with it, and with BLAS threads unset
(``OMP_NUM_THREADS``) or one. ``--squares 10 10`` takes a scan of 100 times the area, 1.6 million pairs.

Run by ``make bench``, or alone: ``scripts/in_env python benchmarks/first_estimate.py [--runs 3]``.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from command import Cost, run_command
from record import record, row
from workload import PAIRS, bump_scan, bump_scene

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.scene import Scene
from tactile_localizer.sim import simulate_scan

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def store(path: Path, scan: Scan, scene: Scene) -> None:
    """Write a scan file without a stored calibration."""
    with ScanStore.create(path, scene) as file:
        for number in scan.sweep_numbers:
            own = scan.sweep == number
            file.begin_sweep()
            file.append(np.arange(np.count_nonzero(own)) * 10_000_000, scan.states[own], scan.strain[own])
            file.end_sweep()


def two_samples(path: Path) -> None:
    """Write a recording of two samples as CSV."""
    test = simulate_scan("bump", 1, "test", sweeps=1)
    names = [f"{finger}_{gauge}" for finger in ("index", "middle") for gauge in range(1, 9)]
    rows = [",".join(("stamp_s", "x", "y", *names))]
    for n in range(2):
        values = (test.stamp_ns[n] * 1e-9, *test.odometry[n], *test.strain[n])
        rows.append(",".join(f"{value:.9g}" for value in values))
    path.write_text("\n".join(rows) + "\n")


def measure(runs: int, squares: tuple[int, int] = (1, 1)) -> list[dict[str, Any]]:
    """Medians over interleaved runs, on a scan of several squares side by side."""
    scan, scene = bump_scan(squares), replace(bump_scene(squares), measurement={})
    unset = {name: value for name, value in os.environ.items() if name not in _THREADS}
    one = unset | dict.fromkeys(_THREADS, "1")
    arguments = ["replay", "two.csv", "--scan", "scan.db"]
    times: dict[str, list[Cost]] = {}
    for _ in range(runs):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            store(folder / "scan.db", scan, scene)
            two_samples(folder / "two.csv")
            for title, environment in (
                ("nothing learned", unset),
                ("learned before", unset),
                ("learned before, one BLAS thread", one),
            ):
                times.setdefault(title, []).append(run_command(arguments, folder, environment))
    limits = {"nothing learned": "<= 5", "learned before": "<= 1"} if len(scan) == PAIRS else {}
    rows = []
    for title, taken in times.items():
        wall_s, cpu_s, peak_mb = np.median(np.array(taken), axis=0)
        name = f"first estimate on {len(scan):,} pairs, {title}"
        rows.append(row(name, wall_s, "s", limits.get(title), pairs=len(scan), cpu_s=float(cpu_s)))
        rows.append(row(f"{name}: processor time", cpu_s, "s"))
        rows.append(row(f"{name}: peak memory", peak_mb, "MB"))
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument(
        "--squares", type=int, nargs=2, default=(1, 1), help="numbers of squares of the scan along x and y"
    )
    given = parser.parse_args()
    record(measure(given.runs, tuple(given.squares)))
