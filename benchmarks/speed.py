"""Speed: what a user waits for with a recording, and decoding of load cells.

    scripts/in_env python benchmarks/speed.py [DIR] [--repeat 5] [--json FILE]

``DIR`` is a folder of ``recorded.py`` (default: ``examples/recordings/engine_bump``). Commands run as a
user's do, each in a process of its own; a time is the median processor time of that process, s, which a busy
machine changes little. ``recorded.py``, ``features.py`` and ``fabrics.py`` have times of measurement updates
beside their errors, ``peers.py`` those of other packages' particle filters.

``import of the package``
    Python with the modules of ``tactile-localizer replay``
``import csv``
    making a scan of the training sweeps
``learning and replay``
    first replay of the test sweeps
``replay``
    the same with the calibration that the first one stored
``first estimate``
    the same of two strains
``import, learning and replay``
    the two commands together
``reading of CSV``
    processor time of reading 162,180 rows of 20 columns, by that of ``numpy.loadtxt``
``decoding``
    recorded time over processor time of decoding and assembling 14 load cells at 500 Hz from memory
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import can
import cantools
import numpy as np
from rows import Row, print_rows, write_rows

from tactile_localizer.io.can.assembler import CycleAssembler
from tactile_localizer.io.can.protocol import LoadCellProtocol
from tactile_localizer.io.csv.columns import channel_names
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.csv.rows import read_rows
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import Axis, Phalanx, Scene

CAN_RATE_HZ = 500.0
_BATCH = 1024
"""Frames that are decoded together, as the driver reads them."""


def commands(folder: Path) -> dict[str, float]:
    """Processor times of the commands on a recording, s, by name."""
    train, test = (next(folder.glob(f"{name}.csv*")) for name in ("train", "test"))
    with tempfile.TemporaryDirectory() as name:
        scan, two = f"{name}/scan", Path(name, "two.csv")
        header, rows = read_rows(test)
        two.write_text("\n".join([",".join(header.names), *list(next(rows).values())[:2]]))
        replay = ["replay", test, "--scan", scan]
        return {
            "import of the package": processor_s("import tactile_localizer.cli.replay"),
            "import csv": command_s("import", "csv", train, "--scene", folder / "scene.yaml", "-o", scan),
            "learning and replay": command_s(*replay),
            "replay": command_s(*replay),
            "first estimate": command_s("replay", two, "--scan", scan),
        }


def command_s(*arguments: object) -> float:
    """Processor time of ``tactile-localizer`` with arguments, s."""
    return processor_s("import sys; from tactile_localizer.cli import main; sys.exit(main())", *arguments)


def processor_s(program: str, *arguments: object) -> float:
    """Processor time of a Python program, s."""
    before = os.times()
    command = [sys.executable, "-c", program, *map(str, arguments)]
    status = subprocess.run(command, check=False, stdout=subprocess.DEVNULL).returncode
    assert status < 2, command  # 1: not every sweep is localized
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def decoding(cycles: int) -> Row:
    """Decoding of two classic frames of each of 14 load cells."""
    dbc = resource_path("config/loadcells.dbc")
    names = dict.fromkeys(
        message.name.rpartition("_")[0] for message in cantools.database.load_file(dbc).messages
    )
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
    return {"name": "decoding", "value": cycles / CAN_RATE_HZ / taken_s, "unit": "x real time"}


def csv_reading(rows: int) -> Row:
    """Reading of a CSV file of stamps, positions and 16 channels, compared with ``numpy.loadtxt``."""
    scene = Scene("wide", (Axis("x", -9, 9), Axis("y", -9, 9)), (Phalanx("finger", (0, 0), 16),))
    numbers = np.random.default_rng(0).normal(size=(rows, 18))
    with tempfile.NamedTemporaryFile("w", suffix=".csv") as file:
        print("stamp_s,sweep,x,y", *channel_names("finger", 16), sep=",", file=file)
        for number, row in enumerate(numbers.tolist()):
            cells = ",".join(f"{value:.5f}" for value in row)
            print(f"{1.7e9 + number / 1000:.6f},{number // 5000},{cells}", file=file)
        file.flush()
        times = []
        for _ in range(5):
            for read in (
                lambda: np.loadtxt(file.name, delimiter=",", skiprows=1),
                lambda: read_csv(file.name, scene),
            ):
                began = time.process_time()
                read()
                times.append(time.process_time() - began)
    ratio = float(np.median(times[1::2]) / np.median(times[::2]))
    return {"name": "reading of CSV", "value": ratio, "unit": "x numpy.loadtxt"}


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "folder", type=Path, nargs="?", default=Path("examples/recordings/engine_bump"), metavar="DIR"
    )
    parser.add_argument("--repeat", type=int, default=5, help="of the commands")
    parser.add_argument("--cycles", type=int, default=5000, help="of the load cells")
    parser.add_argument("--json", type=Path, metavar="FILE")
    given = parser.parse_args()
    times = [commands(given.folder) for _ in range(given.repeat)]
    for each in times:
        each["import, learning and replay"] = each["import csv"] + each["learning and replay"]
    rows: list[Row] = [
        {"name": name, "value": float(np.median([each[name] for each in times])), "unit": "s"}
        for name in times[0]
    ]
    rows += [csv_reading(162_180), decoding(given.cycles)]
    if given.json is not None:
        write_rows(given.json, vars(given), rows, [])
    print_rows(("name", "unit"), {"value": ("value", ".3g")}, rows)


if __name__ == "__main__":
    main()
