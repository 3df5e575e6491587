"""Does the published probability mean what it says? Claimed against observed, over recorded features.

    scripts/in_env python benchmarks/reliability.py DIR ... [--picture FILE] [--json FILE]

Folders are those of ``recorded.py``. A strain that leads to a measurement update claims, by its probability,
that the hand is on the map and within the convergence radius of the estimate; on ``blank`` and ``foreign_*``
sweeps no claim is right. A row is a range of claims, and has

``claimed``, ``observed``
    mean claim of the strains of all files, and the part of them that is right
``claimed_own``, ``observed_own``
    the same of the ``test`` sweeps alone, which are on the map
``low``, ``high``, ``low_own``, ``high_own``
    95 % intervals of the observed, as there are few sweeps (Bayesian bootstrap over sweeps; Rubin, 1981)
``sets``
    number of folders with such strains

Every folder has the same weight, and in it every file.
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

from collections.abc import Sequence
from itertools import pairwise
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
from recorded import find_file, load_recording, localize
from rows import accuracy_parser, in_parallel, print_rows, write_rows

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import scan_of
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.offline.metrics import position_error
from tactile_localizer.offline.tradeoff import named_configuration

EDGES = np.array([0.5, 0.7, 0.85, 0.93, 0.96, 0.98, 1.0])
"""Ranges of claims, below 0.5 of which nobody acts on them."""
RESAMPLED = 1000
"""Times that the sweeps are weighted anew."""
COLUMNS = {
    "claimed": ("claimed", ".3f"),
    "observed": ("observed", ".3f"),
    "low": ("from", ".3f"),
    "high": ("to", ".3f"),
    "claimed_own": ("own: claimed", ".3f"),
    "observed_own": ("observed", ".3f"),
    "low_own": ("from", ".3f"),
    "high_own": ("to", ".3f"),
    "sets": ("sets", "d"),
}


def claims(folder: Path, configuration: Configuration) -> list[dict[str, Any]]:
    """Claims of the strains of a folder, whether they are right, and the weight of each.

    Raises
    ------
    ScanError
        The folder lacks a file, or a file a column.
    """
    scene = load_scene(folder / "scene.yaml")
    train, test = (find_file(folder, name) for name in ("train", "test"))
    if train is None or test is None:
        raise ScanError(f"{folder}: expected train.csv[.gz] and test.csv[.gz]")
    scan = scan_of(load_recording(train, scene), scene)
    localizer = build_localizer(scan, scene, configuration, np.random.default_rng(1))
    blank = find_file(folder, "blank")
    others = ([blank] if blank else []) + sorted(folder.glob("foreign_*.csv*"))
    found: dict[str, list[np.ndarray]] = {"claim": [], "right": [], "weight": [], "own": [], "sweep": []}
    for number, path in enumerate((test, *others)):
        sweeps = localize(localizer, load_recording(path, scene), 1.0, 1)
        claim = np.concatenate([sweep.probability[sweep.updated] for sweep in sweeps])
        error = np.concatenate([position_error(sweep)[sweep.updated] for sweep in sweeps])
        own = np.full(len(claim), path is test)
        found["claim"].append(claim)
        found["own"].append(own)
        found["right"].append(own & (error <= configuration.convergence_radius))
        found["weight"].append(np.full(len(claim), 1.0 / len(claim)))
        counts = [np.count_nonzero(sweep.updated) for sweep in sweeps]
        found["sweep"].append(np.repeat(1000 * number + np.arange(len(sweeps)), counts))
    return [{name: np.concatenate(parts) for name, parts in found.items()}]


def table(sets: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The rows, from the claims of the folders."""
    joined = {name: np.concatenate([each[name] for each in sets]) for name in sets[0]}
    number = np.repeat(np.arange(len(sets)), [len(each["claim"]) for each in sets])
    rows = []
    for lower, upper in pairwise(EDGES):
        inside = (joined["claim"] >= lower) & (joined["claim"] < upper + (upper == EDGES[-1]))
        row: dict[str, Any] = {"range": f"{lower:g} to {upper:g}", "sets": len(np.unique(number[inside]))}
        for suffix, rows_of in (("", inside), ("_own", inside & joined["own"])):
            if rows_of.any():
                weights = joined["weight"][rows_of]
                right, sweep = joined["right"][rows_of], 100_000 * number[rows_of] + joined["sweep"][rows_of]
                row[f"claimed{suffix}"] = float(np.average(joined["claim"][rows_of], weights=weights))
                row[f"observed{suffix}"] = float(np.average(right, weights=weights))
                row[f"low{suffix}"], row[f"high{suffix}"] = interval(right, weights, sweep)
        rows.append(row)
    return rows


def interval(right: np.ndarray, weights: np.ndarray, sweep: np.ndarray) -> tuple[float, float]:
    """95 % interval of the weighted part that is ``right`` (n,), whose strains of a ``sweep`` go together."""
    _, of = np.unique(sweep, return_inverse=True)
    parts = np.random.default_rng(0).exponential(size=(RESAMPLED, of.max() + 1))
    drawn = (parts @ np.bincount(of, weights * right)) / (parts @ np.bincount(of, weights))
    low, high = np.quantile(drawn, [0.025, 0.975]).tolist()
    return low, high


def draw(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """A picture of the table."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.6, 4.2), layout="constrained")
    axes = figure.add_subplot()
    axes.plot([0.5, 1.0], [0.5, 1.0], color="0.6", linewidth=1.0, label="as claimed")
    for suffix, name, style in (("", "with other material", "o-"), ("_own", "on the map alone", "s--")):
        known = [row for row in rows if f"claimed{suffix}" in row]
        claimed, observed = ([row[what + suffix] for row in known] for what in ("claimed", "observed"))
        ends = np.array([(row["low" + suffix], row["high" + suffix]) for row in known]).T
        away = np.abs(np.array(observed) - ends)
        axes.errorbar(claimed, observed, away, fmt=style, markersize=4.0, elinewidth=0.7, label=name)
    axes.axvline(Configuration().convergence_probability, color="0.6", linestyle=":", linewidth=1.0)
    axes.text(Configuration().convergence_probability, 0.02, "converged ", ha="right", fontsize=8)
    axes.set(xlabel="claimed probability", ylabel="part that is right", xlim=(0.5, 1.0), ylim=(0.0, 1.02))
    axes.legend(loc="lower left", frameon=False)
    figure.savefig(path, dpi=130)


def main() -> None:
    """Measure, print, draw and write."""
    parser = accuracy_parser(__doc__)
    parser.add_argument("folders", type=Path, nargs="+", metavar="DIR")
    parser.add_argument("--picture", type=Path, metavar="FILE")
    given = parser.parse_args()
    calls = [(folder, named_configuration(given.configuration)) for folder in given.folders]
    found = in_parallel(claims, calls, given.jobs, "measuring", given.cluster)
    sets = [own for each in found for own in each]
    rows = table(sets)
    print_rows(("range",), COLUMNS, rows)
    if given.picture is not None:
        draw(given.picture, rows)
    if given.json is not None:
        write_rows(given.json, vars(given), sorted(rows, key=itemgetter("range")), [])


if __name__ == "__main__":
    main()
