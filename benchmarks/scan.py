"""Speed of recording and loading scans.

Run by ``make bench``, or alone: ``scripts/in_env python benchmarks/scan.py [--pairs 1000000]``.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from record import record, row

from tactile_localizer.cli import main as command
from tactile_localizer.core.geometry.synchronization import Pairing
from tactile_localizer.core.scan.coverage import Coverage
from tactile_localizer.core.scan.tactile_map import make_map
from tactile_localizer.io.scans.recorder import StrainSample, SweepRecorder
from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.scene import Axis, Phalanx, Scene

SCENE = Scene(
    "square",
    (Axis("x", 0.0, 0.0508), Axis("y", 0.0, 0.0508)),
    (Phalanx("index", (0.0, 0.012)), Phalanx("middle", (0.0, -0.012))),
)
STRAIN_NS, POSE_NS, START_NS = 5_000_000, 10_000_000, 1_700_000_000_000_000_000
SWEEPS = 21


def random_pairs(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps, states on a raster, and strain."""
    rng = np.random.default_rng(0)
    x = np.abs((np.arange(n) * 2 * SWEEPS / n) % 2 - 1) * 0.0508
    y = np.floor(np.arange(n) * SWEEPS / n) * 0.00254
    return START_NS + np.arange(n) * STRAIN_NS, np.column_stack([x, y]), rng.normal(size=(n, 16))


def scan_file(n: int, folder: Path) -> list[dict[str, Any]]:
    """Append ``n`` pairs one by one, as a node does, and load them."""
    stamp_ns, states, strain = random_pairs(n)
    path = folder / "scan.db"
    begin_s = time.perf_counter()
    with ScanStore.create(path, SCENE) as store:
        store.begin_sweep()
        for i in range(n):
            store.append(stamp_ns[i : i + 1], states[i : i + 1], strain[i : i + 1])
    append = n / (time.perf_counter() - begin_s)
    loads = []
    for _ in range(3):
        begin_s = time.perf_counter()
        with ScanStore.open(path) as store:
            scan = store.load()
        loads.append(time.perf_counter() - begin_s)
    assert np.array_equal(scan.strain, strain)
    begin_s = time.perf_counter()
    with contextlib.redirect_stdout(io.StringIO()):
        command(["scan", "info", str(path)])
    info_s = time.perf_counter() - begin_s
    begin_s = time.perf_counter()
    make_map(scan, SCENE)
    map_s = time.perf_counter() - begin_s
    size = path.stat().st_size / 1e6
    return [
        row(
            "scan file: append pair by pair", append, "pairs/s", ">= 5000", pairs=n, phalanges=2, size_mb=size
        ),
        row("scan file: load to arrays", min(loads), "s", "<= 3", pairs=n, worst_s=max(loads)),
        row("scan info", info_s, "s", "<= 3", pairs=n),
        row("tactile map of all elements", map_s, "s", pairs=n),
    ]


def recorder(n: int, folder: Path) -> dict[str, Any]:
    """All that the mapping node does with a message once it is decoded: pair by stamps, screen, append."""
    stamp_ns, states, strain = random_pairs(n)
    status = np.zeros(2, dtype=np.uint8)
    pairing: Pairing[StrainSample] = Pairing(SCENE.axes)
    begin_s = time.perf_counter()
    with ScanStore.create(folder / "recorded.db", SCENE) as store:
        sweeps = SweepRecorder(store, None, Coverage(SCENE))
        sweeps.start(0)
        for i in range(n):
            if i % (POSE_NS // STRAIN_NS) == 0:
                sweeps.take(pairing.add_pose(int(stamp_ns[i]) + 1, states[i]))
            sweeps.take(pairing.add_strain(int(stamp_ns[i]), (strain[i], status)))
        sweeps.close()
    taken_s = time.perf_counter() - begin_s
    return row("mapping: pair with poses, screen and append", n / taken_s, "pairs/s", ">= 5000", pairs=n)


def main() -> None:
    """Measure and record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=1_000_000)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rows = [
            *scan_file(args.pairs, folder),
            recorder(max(args.pairs // 10, 1000), folder),
        ]
    record(rows)


if __name__ == "__main__":
    main()
