"""Simulated material as scans and as recordings."""

from __future__ import annotations

import time

import numpy as np

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.recording import RecordedSweep, Recording, missing_status
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import Scene
from tactile_localizer.sim import SimulatedScan, simulate_scan

PAIRS = 16_321
"""Number of training pairs in the paper."""


def recording_of(scan: SimulatedScan) -> Recording:
    """Simulated sweeps as a recording of the arm's positions, with the truth."""
    sweeps = tuple(
        RecordedSweep(
            number=int(scan.sweep[part.start]),
            stamp_ns=scan.stamp_ns[part],
            position=scan.odometry[part],
            strain=scan.strain[part],
            status=missing_status(scan.strain[part], scan.layout),
            truth=scan.truth[part],
            felt=scan.felt[part],
        )
        for part in scan.slices()
    )
    return Recording(f"simulated {scan.feature}", sweeps)


def shipped_scene(feature: str) -> Scene:
    """The scene that is shipped for a feature."""
    return load_scene(resource_path(f"config/scenes/{feature}.yaml"))


def paper_sized_scan() -> Scan:
    """Scan of the bump with as many pairs as the paper's."""
    scan = simulate_scan("bump", 1, sweeps=22).to_scan()
    return scan.select(np.unique(np.linspace(0, len(scan) - 1, PAIRS).astype(int)))


def read_us(scan: Scan) -> float:
    """Median time of one read (the sum) of the training strains as float32, µs."""
    strain = scan.strain.astype(np.float32)
    times = []
    for _ in range(200):
        began = time.perf_counter()
        strain.sum()
        times.append(time.perf_counter() - began)
    return 1e6 * float(np.median(times))
