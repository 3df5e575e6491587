"""Delays of the strain against the poses: what is found of recorded scans, and what is left of the error.

    scripts/in_env python benchmarks/delays.py [DIR ...] [--delays S ...] [--errors S ...] [--orders N ...]

Folders are those of ``recorded.py`` (default: ``examples/recordings/engine_bump``). Every second sweep of
``train`` is reversed in time, as if scanned there and back at 20 mm/s, and the strain is delayed.
``--orders`` gives the sweeps random orders first, so that others are reversed; 0 is the recorded one. A row
is a folder, an order and a delay, and has

``found_less_ms``, ``interval_ms``
    the delay that is found, less the true one, and half of its 95 % interval, ms
``corrected``
    1 if an import corrects it, else 0
``error_mm``, ``against_none``
    mean error of the converged strains of ``test`` on the map of the scan that is so corrected, mm, and that
    by the error where no delay is added and none corrected; of the ``--errors``
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

from dataclasses import replace
from itertools import product
from operator import itemgetter
from pathlib import Path

import numpy as np
from recorded import find_file, load_recording, localize
from rows import Row, accuracy_parser, measured, print_rows

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import Recording, delay_of, scan_of, undelayed
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.offline.metrics import position_error
from tactile_localizer.offline.tradeoff import named_configuration
from tactile_localizer.scene import Scene

_SPEED = 0.02
"""Speed of the strokes, m/s."""
_COLUMNS = {
    "found_less_ms": ("found less true, ms", "+.1f"),
    "interval_ms": ("interval", ".1f"),
    "corrected": ("corrected", "d"),
    "error_mm": ("error, mm", ".2f"),
    "against_none": ("against none", ".2f"),
}


def there_and_back(recording: Recording, delay_s: float) -> Recording:
    """A recording whose every second sweep is reversed, with strain that is late by a time, s."""
    begin_s, sweeps = 1.0, []
    for number, sweep in enumerate(recording.sweeps):
        way = slice(None, None, -1 if number % 2 else 1)
        position, strain = np.ascontiguousarray(sweep.position[way]), sweep.strain[way]
        step = np.linalg.norm(np.diff(position, axis=0), axis=1)
        time_s = np.concatenate([[0.0], np.cumsum(np.maximum(step / _SPEED, 1e-3))])
        late = np.column_stack([np.interp(time_s - delay_s, time_s, channel) for channel in strain.T])
        stamp_ns = np.round((begin_s + time_s) * 1e9).astype(np.int64)
        begin_s += time_s[-1] + 1.0
        sweeps.append(
            replace(sweep, stamp_ns=stamp_ns, position=position, strain=late, truth=None, felt=None)
        )
    return replace(recording, sweeps=tuple(sweeps))


def error_mm(scan: Recording, test: Recording, scene: Scene, configuration: Configuration) -> float:
    """Mean error of the converged strains of ``test``, mm; NaN if there are none."""
    rng = np.random.default_rng(1)
    localizer = build_localizer(scan_of(scan, scene), scene, configuration, rng)
    replayed = localize(localizer, test, 1.0, 1)
    return 1e3 * float(np.mean(np.concatenate([position_error(each)[each.converged] for each in replayed])))


def ordered(recording: Recording, order: int) -> Recording:
    """A recording with its sweeps in a random order, by its seed; 0: as they are."""
    numbers = np.arange(len(recording.sweeps))
    numbers = np.random.default_rng(order).permutation(numbers) if order else numbers
    return replace(recording, sweeps=tuple(recording.sweeps[number] for number in numbers))


def measure_folder(
    folder: Path, order: int, delays: list[float], with_error: list[float], configuration: Configuration
) -> list[Row]:
    """The rows of a folder in one order.

    Raises
    ------
    ScanError
        The folder lacks a file, or its sweeps have no strokes beside each other.
    """
    scene = load_scene(folder / "scene.yaml")
    train, test = find_file(folder, "train"), find_file(folder, "test")
    if train is None or test is None:
        raise ScanError(f"{folder}: expected train.csv[.gz] and test.csv[.gz]")
    recording, rows = ordered(load_recording(train, scene), order), []
    tried = load_recording(test, scene) if with_error else None
    none_mm = error_mm(there_and_back(recording, 0.0), tried, scene, configuration) if tried else np.nan
    for delay_s in sorted({*delays, *with_error}):
        late = there_and_back(recording, delay_s)
        if (found := delay_of(late, scene.axes)) is None:
            raise ScanError(f"{folder}: expected sweeps in opposite directions side by side, found none")
        row: Row = {"folder": folder.name, "order": order, "delay_ms": round(1e3 * delay_s)}
        row["found_less_ms"], row["interval_ms"] = 1e3 * (found.seconds - delay_s), 1e3 * found.error_s
        row["corrected"] = int(found.is_significant)
        if tried and delay_s in with_error:
            seconds = found.seconds if found.is_significant else 0.0
            row["error_mm"] = error_mm(undelayed(late, scene.axes, seconds), tried, scene, configuration)
            row["against_none"] = row["error_mm"] / none_mm
        rows.append(row)
    return rows


def main() -> None:
    """Measure, print and write."""
    parser = accuracy_parser(__doc__)
    default = [Path("examples/recordings/engine_bump")]
    parser.add_argument("folders", type=Path, nargs="*", default=default, metavar="DIR")
    delays = [0.0, 0.02, 0.04, 0.08, 0.16, 0.3]
    parser.add_argument("--delays", type=float, nargs="+", default=delays, metavar="S")
    parser.add_argument("--errors", type=float, nargs="*", default=[0.08], metavar="S", help="delays, s")
    parser.add_argument("--orders", type=int, nargs="+", default=[0], metavar="N", help="of the sweeps")
    given = parser.parse_args()
    configuration = named_configuration(given.configuration)
    cases = product(given.folders, given.orders)
    calls = [(folder, order, given.delays, given.errors, configuration) for folder, order in cases]
    names = "folder", "order", "delay_ms"
    print_rows(names, _COLUMNS, measured(measure_folder, calls, given, itemgetter(*names), lambda rows: []))


if __name__ == "__main__":
    main()
