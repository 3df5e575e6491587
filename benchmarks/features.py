"""Localization on simulated features, with scenes that give no kernel widths.

    scripts/in_env python benchmarks/features.py [--seeds 81 82 83] [--no-region] [--json FILE]

For each seed and feature a localizer is built from a simulated training scan and the shipped scene without
its parameters, with ``--no-region`` also without the feature's region. It is tried on 18 test sweeps over the
feature, 18 blank sweeps that end before it, and, for what no scan has shown, 18 sweeps over a seam, over each
of the other features and over material without one, the whole way; it is reset at the start of each. A row is
a seed and a feature, and has

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
``foreign_strains``, ``foreign_sweeps``
    share of the strains after contact with the seam that are converged, and of the sweeps with such a strain
``other_strains``, ``other_sweeps``
    the same of the other features
``update_us``, ``update_open_us``, ``learning_s``
    median of a measurement update that is converged, and of one that is not, us; processor time of learning
    from the scan, s

``--probabilities P ...`` repeats everything with these thresholds ``convergence_probability``, and
``--plot FILE`` draws early against false convergence over them. The file of ``--json`` has ``arguments``,
``rows`` and ``totals``: over all rows, of each feature, of each seed, of each threshold. Errors, shares and
times are averaged, counts are summed.
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import time
from collections.abc import Sequence
from dataclasses import replace
from operator import itemgetter
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from measures import (
    COLUMNS,
    Row,
    ever_converged,
    falsely_converged,
    on_feature,
    on_unscanned,
    read_us,
    summary,
    update_times,
)
from rows import accuracy_parser, measured, print_rows

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer, learn
from tactile_localizer.offline.replay import replay
from tactile_localizer.offline.tradeoff import named_configuration
from tactile_localizer.scene import Scene
from tactile_localizer.sim import shipped_scene, simulate_recording, simulate_scan
from tactile_localizer.sim.material import SIMULATED_FEATURES


def measure_feature(
    feature: str, seed: int, configurations: Sequence[Configuration], region: bool, sweeps: int
) -> list[Row]:
    """The rows of one seed and feature, one for each configuration."""
    scene = bare(shipped_scene(feature), region)
    scan = simulate_scan(feature, seed)
    blank = simulate_recording(feature, seed, "test", sweeps=sweeps, reach_feature=False)
    recordings = {
        material: simulate_recording(material, seed, "test", sweeps=sweeps)
        for material in (*SIMULATED_FEATURES, "seam", "none")
    }
    began = time.process_time()
    calibration = learn(scan, scene)
    learning_s = time.process_time() - began
    rows = []
    for configuration in configurations:
        rng = np.random.default_rng(seed)
        localizer = build_localizer(scan, scene, configuration, rng, calibration=calibration)
        sweeps_over = {material: replay(localizer, each) for material, each in recordings.items()}
        own = sweeps_over.pop(feature)
        others = [sweep for other in SIMULATED_FEATURES for sweep in sweeps_over.get(other, [])]
        rows.append(
            {
                "seed": seed,
                "feature": feature,
                "probability": configuration.convergence_probability,
                "sweeps": sweeps,
                **on_feature(own),
                **falsely_converged(own, configuration.convergence_radius),
                "false_blank": ever_converged(replay(localizer, blank)),
                "false_none": ever_converged(sweeps_over["none"]),
                **on_unscanned(sweeps_over["seam"]),
                **on_unscanned(others, "other"),
                "learning_s": learning_s,
                **update_times(own, read_us(scan)),
            }
        )
    return rows


def bare(scene: Scene, region: bool) -> Scene:
    """The scene without parameters of the measurement model, with ``region`` with its feature's region."""
    return replace(scene, feature=scene.feature if region else None)


def totals(rows: Sequence[Row]) -> list[Row]:
    """Over all rows, of each feature, seed and threshold: counts summed, other measures averaged."""
    answer = [{"over": "all", **summary(rows)}]
    for over in ("feature", "seed", "probability"):
        for value in dict.fromkeys(row[over] for row in rows):
            own = [row for row in rows if row[over] == value]
            answer.append({"over": over, over: value, **summary(own)})
    return answer


def convergence_figure(rows: Sequence[Row]) -> Figure:
    """Early and false convergence over the threshold, in percent of the sweeps."""
    points = [row for row in totals(rows) if row["over"] == "probability"]
    curves = (
        ("within_10_mm", "over the feature, 10 mm after contact", "o-", "tab:green"),
        ("within_5_mm", "over the feature, 5 mm after contact", "o-", "tab:blue"),
        ("foreign_sweeps", "false, on a seam that was not scanned", "s--", "tab:red"),
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
    parser = accuracy_parser(__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[81, 82, 83])
    parser.add_argument("--features", nargs="+", choices=SIMULATED_FEATURES, default=SIMULATED_FEATURES)
    parser.add_argument("--sweeps", type=int, default=18, help="of each kind")
    parser.add_argument("--no-region", action="store_true", help="scenes without the feature's region")
    parser.add_argument("--probabilities", type=float, nargs="+", metavar="P")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw convergence over --probabilities")
    given = parser.parse_args()
    base = named_configuration(given.configuration)
    configurations = [
        replace(base, convergence_probability=probability)
        for probability in given.probabilities or [base.convergence_probability]
    ]
    common = configurations, not given.no_region, given.sweeps
    calls = [(feature, seed, *common) for seed in given.seeds for feature in given.features]
    names = ("seed", "feature", "probability")
    rows = measured(measure_feature, calls, given, itemgetter(*names), totals)
    every = [{**row, "seed": row.get("seed", row["over"])} for row in totals(rows)]
    print_rows((*names, "sweeps"), COLUMNS, rows, every)
    if given.plot is not None:
        convergence_figure(rows).savefig(given.plot, dpi=120)


if __name__ == "__main__":
    main()
