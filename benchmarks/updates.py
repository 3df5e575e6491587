"""Times of measurement updates, for :mod:`speed`, which runs this with the package of a source tree.

    python benchmarks/updates.py SCAN RECORDING [--particles N]

Prints a JSON object: the median of an update while the position has converged, while it is open, and of a
strain that leads to none, us, and that of its ratio to a reference measured right after it, as a machine is
faster in one second than in the next; of the particle filter those of any update. The recorded positions are
the odometry. Each sweep is localized twice; what is learned from the scan should be kept in it already.
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import json
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from tactile_localizer import Configuration, load_scan, make_localizer, read_recording

_SOME = np.ones(200)


def reference() -> None:
    """Some work of the interpreter and of numpy, which is the same with any package."""
    values = _SOME
    for _ in range(10):
        values = np.exp(values - 1.0)
    sum(number * number for number in range(100))


def seconds(call: Callable[[], Any]) -> tuple[float, Any]:
    """How long a call takes, and what it returns."""
    began = time.perf_counter()
    found = call()
    return time.perf_counter() - began, found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scan")
    parser.add_argument("recording")
    parser.add_argument("--particles", type=int, metavar="N", help="of a particle filter")
    given = parser.parse_args()
    scan, scene = load_scan(given.scan)
    filtered = {"filter": "particle", "particles": given.particles} if given.particles else {}
    localizer = make_localizer(scan, scene, Configuration(**filtered), scan_file=given.scan)
    times: dict[str, list[tuple[float, float]]] = {"converged": [], "open": [], "without": []}
    for _ in range(2):
        for sweep in read_recording(given.recording, scene).sweeps:
            localizer.reset()
            for sample in sweep.samples():
                taken, estimate = seconds(partial(localizer.update, *sample))
                kind = ("converged" if estimate.converged else "open") if estimate.updated else "without"
                times[kind].append((1e6 * taken, taken / seconds(reference)[0]))
    if given.particles:
        times = {"any": times["converged"] + times["open"]}
    print(json.dumps({kind: np.median(taken, axis=0).tolist() for kind, taken in times.items()}))


if __name__ == "__main__":
    main()
