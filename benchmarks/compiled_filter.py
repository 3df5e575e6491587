"""Time of an update of the particle filter in C++ (``particle_filter.cpp``), for :mod:`speed`.

    python benchmarks/compiled_filter.py SCAN RECORDING --particles N

Prints the median, us, and the error of the last estimate, m: the time of a filter that does not find the
place says nothing. It is compiled for this processor, and is given the map of the scan and the measurements
of the sweeps as the localizer makes them, without their levels, which are known from the recorded positions.
"""

import argparse
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from tactile_localizer import Configuration, load_scan, make_localizer, read_recording
from tactile_localizer.core.likelihood.on_map import Components
from tactile_localizer.core.likelihood.student_t import DEGREES_OF_FREEDOM

COMPILER = "c++"
_OPTIONS = "-O3", "-march=native", "-ffast-math", "-std=c++17"


def task(scan_file: str, recording: str, particles: int) -> tuple[bytes, np.ndarray]:
    """What the filter reads, and where the last sweep ends, (d,)."""
    scan, scene = load_scan(scan_file)
    localizer = make_localizer(scan, scene, Configuration(), scan_file=scan_file)
    model, taken, strains, motions = localizer.model, localizer.measurements, [], []
    present = np.ones(len(scene.phalanges), dtype=bool)
    for sweep in read_recording(recording, scene).sweeps:
        taken.reset()
        felt, positions = [], []
        for stamp_ns, position, strain, _ in sweep.samples():
            if measurement := taken.observe(stamp_ns, position, strain, present):
                exponent = min(1.0, measurement.travel / localizer.information_length)
                motions.append([*measurement.displacement, exponent])
                felt.append(model.whitened(measurement.strain))
                positions.append(position - measurement.pending)
        level = np.median(np.array(felt) - model.map_at(np.array(positions))[1], axis=0)
        strains.append(np.array(felt) - level)
    layout, found = model.noise.layout, Components.distinct(model.map, model.noise.layout)
    nodes, others = np.arange(len(found.mean)), np.arange(len(found.mean)).repeat(found.counts)
    by_node = np.concatenate([nodes, others]).argsort(kind="stable")
    signals = np.concatenate([found.mean, found.mean[others] + found.away])[by_node]
    spread = np.concatenate([found.spread, found.other_spread], axis=1)[:, by_node]
    sizes = [particles, len(motions), scene.dimension, layout.phalanges, len(signals)]
    bounds, starts = np.cumsum([0, *layout.counts]), np.cumsum([0, *1 + found.counts])
    integers = np.concatenate([sizes, model.map.shape, bounds, starts]).astype(np.int64)
    lattice, box = (model.map.origin, model.map.step), (scene.lower, scene.upper, scene.motion_std)
    constants, steps = [DEGREES_OF_FREEDOM, model.gain_variance], np.ravel(motions)
    numbers = np.concatenate([*lattice, *box, constants, steps, np.concatenate(strains).ravel()])
    return b"".join(part.tobytes() for part in (integers, numbers, signals, spread)), positions[-1]


def main() -> None:
    """Compile, measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scan")
    parser.add_argument("recording")
    parser.add_argument("--particles", type=int, required=True, metavar="N")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        source, program = Path(__file__).with_name("particle_filter.cpp"), f"{folder}/particle_filter"
        subprocess.run([COMPILER, *_OPTIONS, "-o", program, source], check=True)
        read, end = task(given.scan, given.recording, given.particles)
        printed = subprocess.run([program], input=read, check=True, capture_output=True).stdout
    taken, *estimate = map(float, printed.split())
    print(taken, np.linalg.norm(np.array(estimate) - end))


if __name__ == "__main__":
    main()
