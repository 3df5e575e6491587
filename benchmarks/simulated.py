"""A scan of the paper's size, and the time of reading it."""

from __future__ import annotations

import time

import numpy as np

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.sim import simulate_scan

PAIRS = 16_321
"""Number of training pairs in the paper."""


def paper_sized_scan() -> Scan:
    """Scan of the bump with as many pairs as the paper's."""
    scan = simulate_scan("bump", 1, sweeps=22)
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
