"""Load a scan file and update a filter once; prints the times, s, and the peak memory, MB.

Run by ``benchmarks/core.py`` in a separate process, which imports only what loading needs.
"""

import math
import sys
import time
from pathlib import Path

import numpy as np

from tactile_localizer.core.filters.particle import ParticleFilter
from tactile_localizer.core.likelihood.sum_of_gaussians import SumOfGaussians
from tactile_localizer.io.scans.store import ScanStore

POSITION_STD, STRAIN_STD = 0.0254 * math.sqrt(0.0075), math.sqrt(0.001)


def peak_mb() -> float:
    """Peak memory of this process so far, MB; ru_maxrss would be inherited from the parent."""
    return float(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]) / 1e3


start_mb, begin = peak_mb(), time.perf_counter()
with ScanStore.open(sys.argv[1]) as store:
    scene, model = store.scene, SumOfGaussians(store.load(), store.scene, POSITION_STD, STRAIN_STD)
particles = ParticleFilter(scene, np.random.default_rng(0), 75)
loaded_s, loaded_mb, begin = time.perf_counter() - begin, peak_mb(), time.perf_counter()
particles.update(model.log_likelihood(particles.prior()[0], np.zeros(16), np.ones(2, dtype=bool)))
print(loaded_s, time.perf_counter() - begin, start_mb, loaded_mb, peak_mb())
