"""Speed: what a user waits for with a recording, and decoding of load cells.

    scripts/in_env python benchmarks/speed.py [DIR] [--repeat 5] [--pairs N...] [--beside TREE] [--json FILE]

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
``N pairs: import csv``, ``first estimate``
    the same with a scan of so many pairs, simulated lines that are passed again and again with other noise,
    and the largest resident size of the process, MB
``update converged``, ``update open``, ``strain without update``, ``update of N particles``
    of the localizer on the test sweeps (:mod:`updates`), us, median
``update of N particles, C++``
    of a particle filter in C++ on the same map (:mod:`compiled_filter`), where there is a compiler
``reading of CSV``
    processor time of reading 162,180 rows of 20 columns, by that of ``numpy.loadtxt``
``decoding``
    recorded time over processor time of decoding and assembling 14 load cells at 500 Hz from memory
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import can
import cantools
import numpy as np
from compiled_filter import COMPILER
from rows import Row, print_rows, write_rows

from tactile_localizer.io.can.assembler import CycleAssembler
from tactile_localizer.io.can.protocol import LoadCellProtocol
from tactile_localizer.io.csv.columns import channel_names
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.csv.rows import read_rows
from tactile_localizer.io.scene_file import save_scene
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import Axis, Phalanx, Scene
from tactile_localizer.sim import shipped_scene, simulate_recording

CAN_RATE_HZ = 500.0
_TREE = Path(__file__).resolve().parents[1]
_PARTICLES = 1_000, 10_000
_BATCH = 1024
"""Frames that are decoded together, as the driver reads them."""


class Cost(NamedTuple):
    """Processor time of a command, s, and its largest resident size, MB."""

    seconds: float
    memory: float


def commands(folder: Path, tree: Path) -> dict[str, Cost]:
    """Costs of the commands of a source tree on a recording, by name."""
    train, test = (next(folder.glob(f"{name}.csv*")) for name in ("train", "test"))
    with tempfile.TemporaryDirectory() as name:
        scan, two = f"{name}/scan", Path(name, "two.csv")
        header, rows = read_rows(test)
        two.write_text("\n".join([",".join(header.names), *list(next(rows).rows().values())[:2]]))
        replay = ["replay", test, "--scan", scan]
        return {
            "import of the package": cost(tree, "import tactile_localizer.cli.replay"),
            "import csv": command(tree, "import", "csv", train, "--scene", folder / "scene.yaml", "-o", scan),
            "learning and replay": command(tree, *replay),
            "replay": command(tree, *replay),
            "first estimate": command(tree, "replay", two, "--scan", scan),
        }


def commands_on(pairs: int, trees: Sequence[Path]) -> list[dict[str, Cost]]:
    """Costs of the commands of each source tree on a scan of so many pairs."""
    found = []
    with tempfile.TemporaryDirectory() as name:
        train, two = Path(name, "train.csv"), Path(name, "two.csv")
        save_scene(shipped_scene("bump"), f"{name}/scene.yaml")
        write_lines(train, pairs)
        with train.open() as file:
            two.write_text("".join(islice(file, 3)))
        for number, tree in enumerate(trees):
            scan = f"{name}/scan_{number}"
            first = "replay", two, "--scan", scan
            made = command(tree, "import", "csv", train, "--scene", f"{name}/scene.yaml", "-o", scan)
            command(tree, *first)  # keeps what it learned
            costs = {"import csv": made, "first estimate": command(tree, *first)}
            found.append({f"{pairs} pairs: {what}": each for what, each in costs.items()})
    return found


def updates(folder: Path, trees: Sequence[Path], repeat: int) -> list[dict[str, list[float]]]:
    """Times of the updates of each source tree on a recording, by name; the trees take turns.

    In us and, but for those in C++, as ratios to a reference that is measured beside each update.
    """
    train, test = (next(folder.glob(f"{name}.csv*")) for name in ("train", "test"))
    names = {
        "update converged": ("converged", ()),
        "update open": ("open", ()),
        "strain without update": ("without", ()),
        **{f"update of {count} particles": ("any", ("--particles", str(count))) for count in _PARTICLES},
    }
    runs: list[dict[str, list[list[float]]]] = [{name: [] for name in names} for _ in trees]
    with tempfile.TemporaryDirectory() as scans:
        for number, tree in enumerate(trees):
            scan = f"{scans}/{number}"
            command(tree, "import", "csv", train, "--scene", folder / "scene.yaml", "-o", scan)
        for _ in range(repeat):
            for number, tree in enumerate(trees):
                printed = {
                    options: json.loads(_of_tree(tree, "updates", f"{scans}/{number}", test, *options))
                    for _, options in names.values()
                }
                for name, (kind, options) in names.items():
                    runs[number][name].append(printed[options][kind])
            for count in _PARTICLES if shutil.which(COMPILER) else ():
                options = "--particles", str(count)
                taken, _ = _of_tree(trees[0], "compiled_filter", f"{scans}/0", test, *options).split()
                runs[0].setdefault(f"update of {count} particles, C++", []).append([float(taken)])
    return [{name: np.median(times, axis=0).tolist() for name, times in each.items()} for each in runs]


def _of_tree(tree: Path, name: str, *arguments: object) -> str:
    """What a script beside this one prints with the package of a source tree."""
    script = "import sys; del sys.argv[0]; __file__ = sys.argv[0]; exec(open(__file__).read())"
    path = Path(__file__).resolve().with_name(f"{name}.py")
    line = [sys.executable, "-c", script, str(path), *map(str, arguments)]
    return subprocess.run(line, cwd=tree, check=True, capture_output=True, text=True).stdout


def write_lines(path: Path, pairs: int) -> None:
    """Write a CSV file of simulated lines that are passed again and again, each time with other noise."""
    rng, lines, scene = np.random.default_rng(0), simulate_recording("bump", 1).sweeps, shipped_scene("bump")
    names = [name for each in scene.phalanges for name in channel_names(each.name, each.channels)]
    row = ",".join(["%.9f", "%d", *["%.7f"] * scene.dimension, *["%.6f"] * len(names)]) + "\n"
    with path.open("w") as file:
        print("stamp_s", "sweep", *scene.axis_names, *names, sep=",", file=file)
        for number in range(round(pairs / sum(map(len, lines))) * len(lines)):
            line = lines[number % len(lines)]
            shift, level = rng.normal(0.0, [2e-4, 4e-4]), rng.normal(0.0, 0.01, len(names))
            position = np.clip(line.position + shift, scene.lower, scene.upper)
            strain = line.strain + level + rng.normal(0.0, 0.005, line.strain.shape)
            stamp_s = 1e-9 * (line.stamp_ns - line.stamp_ns[0]) + 10.0 * (number + 1)
            each = zip(stamp_s, position, strain, strict=True)
            file.writelines(row % (stamp, number, *place, *felt) for stamp, place, felt in each)


def command(tree: Path, *arguments: object) -> Cost:
    """Cost of ``tactile-localizer`` of a source tree with arguments."""
    return cost(tree, "import sys; from tactile_localizer.cli import main; sys.exit(main())", *arguments)


def cost(tree: Path, program: str, *arguments: object) -> Cost:
    """Cost of a Python program, which imports what is in the folder where it is started, before all else."""
    line, environment = [sys.executable, "-c", program, *map(str, arguments)], os.environ.copy()
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # else each process compiles the package anew
    process = subprocess.Popen(line, cwd=tree, env=environment, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert 0 <= process.returncode < 2, line  # 1: not every sweep is localized
    return Cost(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)


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
    text = "sizes of other scans, such as 162000 1000000"
    parser.add_argument("--pairs", type=int, nargs="*", default=(), metavar="N", help=text)
    text = "source tree of another version, whose commands take turns with these"
    parser.add_argument("--beside", type=Path, metavar="TREE", help=text)
    parser.add_argument("--cycles", type=int, default=5000, help="of the load cells")
    parser.add_argument("--json", type=Path, metavar="FILE")
    given = parser.parse_args()
    trees = [_TREE, *filter(None, [given.beside])]
    runs = [[commands(given.folder.resolve(), tree) for tree in trees] for _ in range(given.repeat)]
    costs = [
        {name: Cost(*np.median([run[number][name] for run in runs], axis=0)) for name in runs[0][number]}
        for number in range(len(trees))
    ]
    for each in costs:
        parts = each["import csv"], each["learning and replay"]
        each["import, learning and replay"] = Cost(
            sum(part.seconds for part in parts), max(part.memory for part in parts)
        )
    for pairs in given.pairs:
        for own, more in zip(costs, commands_on(pairs, trees), strict=True):
            own |= more
    rows: list[Row] = []
    for name, (seconds, memory) in costs[0].items():
        rows.append({"name": name, "value": seconds, "unit": "s", "memory": memory})
        if given.beside is not None:
            other = costs[1][name]
            rows[-1] |= {"ratio": seconds / other.seconds, "memory_ratio": memory / other.memory}
    times = updates(given.folder.resolve(), trees, given.repeat)
    for name, taken in times[0].items():
        rows.append({"name": name, "value": taken[0], "unit": "us"})
        if given.beside is not None and name in times[1]:
            rows[-1]["ratio"] = taken[1] / times[1][name][1]
    rows += [csv_reading(162_180), decoding(given.cycles)]
    if given.json is not None:
        write_rows(given.json, vars(given), rows, [])
    columns = {"value": ("value", ".3g"), "ratio": ("times beside", ".2f")}
    columns |= {"memory": ("MB", ".0f"), "memory_ratio": ("times beside", ".2f")}
    print_rows(("name", "unit"), columns, rows)


if __name__ == "__main__":
    main()
