"""Localization on simulated features, with scenes that give no kernel widths.

    scripts/in_env python benchmarks/features.py [--seeds 81 82 83] [--no-region] [--json FILE]

For each seed and feature a localizer is built from a simulated training scan and the shipped scene without
its parameters, with ``--no-region`` also without the feature's region. It is tried on 18 test sweeps over the
feature, 18 blank sweeps that end before it, and, for what no scan has shown, 18 sweeps over a seam and 18
over material without a feature, the whole way; it is reset at the start of each. A row is a seed and a
feature, and has

``error_mm``, ``error_settled_mm``
    mean over the sweeps of the mean error from contact to the feature's end, and from 4 mm after contact, mm
``coverage``, ``coverage_contact``
    share of the strains whose 95 % region holds the truth, over whole sweeps and from contact to the
    feature's end; mean over the sweeps
``within_5_mm``, ``within_10_mm``
    share of the sweeps that converge at most so far past contact; at ``false_before`` of them it was before
``false_sweeps``, ``false_strains``
    share of the sweeps that are ever, from contact on, converged and more than the convergence radius off;
    share of the converged strains that are so far off
``false_blank``, ``false_before``, ``false_none``
    how many blank sweeps, sweeps over the feature before contact, and sweeps over featureless material ever
    converge
``seam_strains``, ``seam_sweeps``
    share of the strains after contact with the seam that are converged, and of the sweeps with such a strain
``update_us``, ``update_open_us``, ``learning_s``
    median of a measurement update that is converged, and of one that is not, us; processor time of learning
    from the scan, s

``--probabilities P ...`` repeats everything with these thresholds ``convergence_probability``, and
``--plot FILE`` draws early against false convergence over them. The file of ``--json`` has ``arguments``,
``rows`` and ``totals``: over all rows, of each feature, of each seed, of each threshold. Errors, shares and
times are averaged, counts are summed.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from measures import Row, ever_converged, falsely_converged, on_feature, on_unscanned, update_times
from rows import in_parallel, print_rows, write_rows
from simulated import read_us

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer, learn
from tactile_localizer.io.configuration_file import load_configuration
from tactile_localizer.offline.replay import replay
from tactile_localizer.scene import Scene
from tactile_localizer.sim import shipped_scene, simulate_recording, simulate_scan
from tactile_localizer.sim.material import SIMULATED_FEATURES


def measure_feature(
    feature: str, seed: int, configurations: Sequence[Configuration], region: bool, sweeps: int
) -> list[Row]:
    """The rows of one seed and feature, one for each configuration."""
    scene = bare(shipped_scene(feature), region)
    scan = simulate_scan(feature, seed)
    own, blank, seam, none = (
        simulate_recording(material, seed, "test", sweeps=sweeps, reach_feature=reach)
        for material, reach in ((feature, True), (feature, False), ("seam", True), ("none", True))
    )
    began = time.process_time()
    calibration = learn(scan, scene)
    learning_s = time.process_time() - began
    rows = []
    for configuration in configurations:
        rng = np.random.default_rng(seed)
        localizer = build_localizer(scan, scene, configuration, rng, calibration=calibration)
        replayed = replay(localizer, own)
        seam_strains, seam_sweeps = on_unscanned(replay(localizer, seam))
        rows.append(
            {
                "seed": seed,
                "feature": feature,
                "probability": configuration.convergence_probability,
                "sweeps": sweeps,
                **on_feature(scene, replayed),
                **falsely_converged(scene, replayed, configuration.convergence_radius),
                "false_blank": ever_converged(replay(localizer, blank)),
                "false_none": ever_converged(replay(localizer, none)),
                "seam_strains": seam_strains,
                "seam_sweeps": seam_sweeps,
                "learning_s": learning_s,
                **update_times(replayed, read_us(scan)),
            }
        )
    return rows


def bare(scene: Scene, region: bool) -> Scene:
    """The scene without parameters of the measurement model, with ``region`` with its feature's region."""
    return replace(scene, measurement={}, feature=scene.feature if region else None)


_COUNTS = ("false_blank", "false_before", "false_none", "sweeps")
_COLUMNS = {
    "error_mm": ("error", ".2f"),
    "error_settled_mm": ("settled", ".2f"),
    "coverage": ("cover", ".3f"),
    "coverage_contact": ("contact", ".3f"),
    "within_5_mm": ("in 5 mm", ".3f"),
    "within_10_mm": ("in 10 mm", ".3f"),
    "false_sweeps": ("false sweeps", ".3f"),
    "false_strains": ("strains", ".4f"),
    "false_blank": ("blank", "d"),
    "false_before": ("before", "d"),
    "false_none": ("none", "d"),
    "seam_strains": ("seam, strains", ".3f"),
    "seam_sweeps": ("sweeps", ".3f"),
    "learning_s": ("learning, s", ".1f"),
    "update_us": ("update, us", ".0f"),
    "update_open_us": ("open", ".0f"),
}


def totals(rows: Sequence[Row]) -> list[Row]:
    """Over all rows, of each feature, seed and threshold: counts summed, other measures averaged."""
    groups: list[tuple[Row, list[Row]]] = [({"over": "all"}, list(rows))]
    for over in ("feature", "seed", "probability"):
        for value in dict.fromkeys(row[over] for row in rows):
            groups.append(({"over": over, over: value}, [row for row in rows if row[over] == value]))
    answer = []
    for what, own in groups:
        summed = {key: sum(row[key] for row in own) for key in _COUNTS}
        known = {key: [row[key] for row in own if row[key] is not None] for key in _COLUMNS}
        averaged = {
            key: float(np.mean(values)) for key, values in known.items() if values and key not in _COUNTS
        }
        answer.append({**what, **summed, **averaged})
    return answer


def show(rows: Sequence[Row]) -> None:
    """Print the rows, and below them the totals."""
    every = [{**row, "seed": row.get("seed", row["over"])} for row in totals(rows)]
    print_rows(("seed", "feature", "probability", "sweeps"), _COLUMNS, rows, every)


def convergence_figure(rows: Sequence[Row]) -> Figure:
    """Early and false convergence over the threshold, in percent of the sweeps."""
    points = [row for row in totals(rows) if row["over"] == "probability"]
    curves = (
        ("within_10_mm", "over the feature, 10 mm after contact", "o-", "tab:green"),
        ("within_5_mm", "over the feature, 5 mm after contact", "o-", "tab:blue"),
        ("seam_sweeps", "false, on a seam that was not scanned", "s--", "tab:red"),
        ("false_sweeps", "false, on the feature", "^--", "tab:orange"),
    )
    figure = Figure(figsize=(7.6, 3.4), layout="constrained")
    plot = figure.subplots()
    places = np.arange(len(points))
    default = Configuration().convergence_probability
    for name, label, style, colour in curves:
        plot.plot(places, [100 * point[name] for point in points], style, color=colour, ms=5, label=label)
    nothing = [max(point[f"false_{name}"] for name in ("before", "blank", "none")) for point in points]
    share = 100 * np.array(nothing) / [point["sweeps"] for point in points]
    plot.plot(places, share, "x--", color="0.4", ms=5, label="false, before contact, blank or featureless")
    labels = [
        f"{p:g} (default)" if p == default else f"{p:g}" for p in (one["probability"] for one in points)
    ]
    plot.set_xticks(places, labels)
    plot.set_ylim(-3.0, 103.0)
    plot.set_xlabel("convergence_probability")
    plot.set_ylabel("sweeps that converge, %")
    plot.grid(color="0.92")
    figure.legend(loc="outside right center", fontsize=8, frameon=False)
    return figure


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[81, 82, 83])
    parser.add_argument("--features", nargs="+", choices=SIMULATED_FEATURES, default=SIMULATED_FEATURES)
    parser.add_argument("--sweeps", type=int, default=18, help="of each kind")
    parser.add_argument("--no-region", action="store_true", help="scenes without the feature's region")
    parser.add_argument("--configuration", default="default", help="default, a preset, or a YAML file")
    parser.add_argument("--probabilities", type=float, nargs="+", metavar="P")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw convergence over --probabilities")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--json", type=Path, metavar="FILE")
    given = parser.parse_args()
    base = load_configuration(None if given.configuration == "default" else given.configuration)
    configurations = [
        replace(base, convergence_probability=probability)
        for probability in given.probabilities or [base.convergence_probability]
    ]
    common = configurations, not given.no_region, given.sweeps
    calls = [(feature, seed, *common) for seed in given.seeds for feature in given.features]
    rows: list[Row] = []
    for own in in_parallel(measure_feature, calls, given.jobs, "scans"):
        rows = sorted(rows + own, key=lambda row: (row["seed"], row["feature"], row["probability"]))
        if given.json is not None:
            write_rows(given.json, vars(given), rows, totals(rows))
    show(rows)
    if given.plot is not None:
        convergence_figure(rows).savefig(given.plot, dpi=120)


if __name__ == "__main__":
    main()
