"""Speed: learning, the whole measurement update, replay, decoding of load cells, in one thread.

    scripts/in_env python benchmarks/speed.py [DIR ...] [--json FILE]

Measured on a simulated bump with a scan of the paper's size. A ``DIR`` is a folder of ``recorded.py`` or of
``fabrics.py``, on which the update is measured too. A row has a ``value`` in its ``unit``; that of a
measurement update also has ``reads``, the time in reads of the training strains as float32, measured in the
same run. ``peers.py`` compares the particle filter with those of other packages.

``<scan>: learning``
    processor time of learning from the scan, s
``<scan>: update, converged`` and ``open``
    median processor time of a measurement update of the default configuration that is converged, or is not
``<map>: update, own``, ``speed``, ``force``
    the same of a map of cloth, converged or not, on a recording of the same session and of another
``replay``
    recorded time over processor time of replaying ten minutes at 200 Hz
``decoding``
    recorded time over processor time of decoding and assembling 14 load cells at 500 Hz from memory
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import time
from pathlib import Path

import can
import numpy as np
from fabric_recordings import Perturbation, find_conditions, find_pairs
from fabrics import measure_map
from measures import Row, update_times
from recorded import Variant, measure_folder
from rows import print_rows, write_rows
from simulated import paper_sized_scan, read_us

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer, learn
from tactile_localizer.io.can.assembler import CycleAssembler
from tactile_localizer.io.can.layout import load_dbc
from tactile_localizer.io.can.protocol import LoadCellProtocol
from tactile_localizer.offline.replay import replay
from tactile_localizer.resources import resource_path
from tactile_localizer.sim import shipped_scene, simulate_recording

REPLAY_RATE_HZ, CAN_RATE_HZ = 200.0, 500.0
_BATCH = 1024
"""Frames that are decoded together, as the driver reads them."""


def on_bump(sweeps: int) -> list[Row]:
    """Learning, updates and replay on the simulated bump."""
    scan, scene = paper_sized_scan(), shipped_scene("bump")
    began = time.process_time()
    calibration = learn(scan, scene)
    rows = [_row("bump: learning", time.process_time() - began, "s")]
    localizer = build_localizer(
        scan, scene, Configuration(), np.random.default_rng(0), calibration=calibration
    )
    recording = simulate_recording("bump", 1, "test", sweeps=sweeps, rate=REPLAY_RATE_HZ)
    began = time.process_time()
    replayed = replay(localizer, recording)
    taken_s = time.process_time() - began
    rows += _update_rows("bump", update_times(replayed, read_us(scan)))
    real_s = len(recording) / REPLAY_RATE_HZ
    return [*rows, _row("replay", real_s / taken_s, "x real time")]


def on_folder(folder: Path) -> list[Row]:
    """Learning and updates on a recorded feature, or updates on the first map of cloth."""
    if (folder / "scene.yaml").exists():
        (row,) = measure_folder(folder, Variant(), Configuration(), 1)
        name = row["folder"]
        return [_row(f"{name}: learning", row["learning_s"], "s"), *_update_rows(name, row)]
    pairs = [pair for pair in find_pairs(find_conditions(folder)) if pair.kind != "wrong"]
    mapped = max(pairs, key=lambda pair: len({other.kind for other in pairs if other.map == pair.map})).map
    own = {pair.kind: pair for pair in pairs if pair.map == mapped}
    rows = measure_map(mapped, list(own.values()), Configuration(), Perturbation(), 2, False)
    return [_row(f"{mapped.name}: learning", rows[0]["learning_s"], "s")] + [
        _row(f"{mapped.name}: update, {row['kind']}", row["update_us"], "us", reads=row["update_reads"])
        for row in rows
    ]


def decoding(cycles: int) -> list[Row]:
    """Decoding of two classic frames of each of 14 load cells."""
    dbc = resource_path("config/loadcells.dbc")
    names = dict.fromkeys(message.name.rpartition("_")[0] for message in load_dbc(dbc).messages)
    protocol = LoadCellProtocol(dbc, tuple(names))
    rng = np.random.default_rng(0)
    frames: list[can.Message] = []
    for number in range(cycles):
        for cell in range(len(protocol.phalanges)):
            stamp_s = 1.7e9 + number / CAN_RATE_HZ
            frames += protocol.encode(cell, rng.normal(0, 0.5, 8), number, stamp_s=stamp_s)
    assembler = CycleAssembler(protocol)
    began = time.process_time()
    made = sum(len(assembler.feed(frames[i : i + _BATCH])) for i in range(0, len(frames), _BATCH))
    taken_s = time.process_time() - began
    assert made >= cycles - 5, f"expected {cycles} cycles, got {made}"
    return [_row("decoding", cycles / CAN_RATE_HZ / taken_s, "x real time")]


def _row(name: str, value: float, unit: str, **more: float) -> Row:
    return {"name": name, "unit": unit, "value": value, **more}


def _update_rows(name: str, times: Row) -> list[Row]:
    return [
        _row(f"{name}: update, {state}", times[f"{key}_us"], "us", reads=times[f"{key}_reads"])
        for key, state in (("update", "converged"), ("update_open", "open"))
        if times[f"{key}_us"] is not None
    ]


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", type=Path, nargs="*", metavar="DIR")
    parser.add_argument("--sweeps", type=int, default=90, help="of the replay, 7 s each")
    parser.add_argument("--cycles", type=int, default=5000, help="of the load cells")
    parser.add_argument("--json", type=Path, metavar="FILE")
    given = parser.parse_args()
    rows = on_bump(given.sweeps) + decoding(given.cycles)
    rows += [row for folder in given.folders for row in on_folder(folder)]
    if given.json is not None:
        write_rows(given.json, vars(given), rows, [])
    print_rows(("name", "unit"), {"value": ("value", ".4g"), "reads": ("reads", ".1f")}, rows)


if __name__ == "__main__":
    main()
