"""Early against false convergence over the threshold ``convergence_probability``, on simulated features.

    scripts/in_env python benchmarks/convergence.py [--features bump] [--sweeps N] [--seeds N] [--out DIR]

For each feature and seed the default replays N test sweeps (9) over the feature, N blank sweeps that end
before it, N sweeps over featureless material and N over a seam that is not on the map. The belief does not
depend on the threshold, so that one replay of each gives the whole curve. The script prints a table and draws
convergence.png into DIR (out/convergence), where results of tasks are kept; an interrupted run resumes.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from evaluation.comparison import Trial, learn_conditions
from evaluation.conditions import (
    SimulatedCondition,
    recording_of,
)
from evaluation.jobs import (
    Progress,
    Task,
    Workers,
    configuration_identity,
    run_tasks,
)
from evaluation.report import save_figures
from matplotlib.figure import Figure

from tactile_localizer.cli.interrupts import end_as_by_interrupt
from tactile_localizer.cli.progress import progress_bars
from tactile_localizer.cli.tables import print_tables
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.decision.convergence import Convergence, ConvergenceCriteria
from tactile_localizer.core.factory import convergence_criteria
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.offline.axes import MM
from tactile_localizer.offline.metrics import travel_from_contact
from tactile_localizer.offline.replay import Track, replay
from tactile_localizer.offline.table import Table
from tactile_localizer.sim import simulate_scan
from tactile_localizer.sim.material import SIMULATED_FEATURES

PROBABILITIES = (0.9, 0.95, 0.99, 0.999, 0.9999)
"""Thresholds tried beside that of the configuration."""
WITHIN_M = (0.005, 0.010)
"""Travel from contact within which convergence is counted, m."""
UNSCANNED = ("seam", "none")
"""Simulated materials beside the scanned one: another feature, and no feature at all."""


@dataclass(frozen=True)
class CurvePoint:
    """Convergence under one threshold.

    Parameters
    ----------
    probability : the threshold
    within : fractions of the sweeps over the feature that converge within each of :data:`WITHIN_M` of
        contact
    median_m : travel from contact to convergence, m; NaN where fewer than half of the sweeps converge
    before : fraction of those sweeps that converge before contact
    blank : fraction of the sweeps ending before the feature that converge
    featureless : fraction of the sweeps over material without a feature that converge
    seam_sweeps, seam_strains : fractions of the sweeps over a seam, and of their strains from contact on,
        that are converged
    """

    probability: float
    within: tuple[float, ...]
    median_m: float
    before: float
    blank: float
    featureless: float
    seam_sweeps: float
    seam_strains: float


def convergence_curve(
    conditions: Sequence[SimulatedCondition],
    configuration: Configuration,
    folder: Path,
    workers: Workers,
    progress: Progress | None = None,
) -> list[CurvePoint]:
    """The curve over simulated features; results that ``folder`` holds are reused."""
    learned = learn_conditions(conditions, folder, workers, progress)
    choices = configuration_identity(configuration)
    tasks = [
        Task(
            decide,
            (condition, calibration, configuration),
            {"condition": condition.identity, "calibration": calibration, "configuration": choices},
        )
        for condition, calibration in zip(conditions, learned, strict=True)
    ]
    results = run_tasks(tasks, folder, workers, progress, "replaying")
    return [_point(thresholds) for thresholds in zip(*(one["points"] for one in results), strict=True)]


def decide(
    condition: SimulatedCondition, calibration: dict[str, Any], configuration: Configuration
) -> dict[str, Any]:
    """Travel to convergence of every sweep and false convergence, for each threshold."""
    material = condition.load()
    localizer = Trial(condition, configuration, calibration).localizer(material)
    own = replay(localizer, material.recording)
    blank = replay(localizer, material.blank) if material.blank is not None else []
    seam, nothing = (
        unscanned_tracks(localizer, name, condition.seed, condition.sweeps) for name in UNSCANNED
    )
    criteria = convergence_criteria(material.scene, configuration)
    points = []
    for probability in sorted({*PROBABILITIES, configuration.convergence_probability}):
        tried = replace(criteria, probability=probability)
        on_seam = [from_contact(track, decisions(track, tried)) for track in seam]
        points.append(
            {
                "probability": probability,
                "travel_m": [_travel_to(track, decisions(track, tried)) for track in own],
                "blank": [bool(decisions(track, tried).any()) for track in blank],
                "featureless": [bool(decisions(track, tried).any()) for track in nothing],
                "seam_sweeps": [bool(flags.any()) for flags in on_seam],
                "seam_strains": [float(flags.mean()) for flags in on_seam if len(flags)],
            }
        )
    return {"points": points}


def unscanned_tracks(localizer: Localizer, material: str, seed: int, sweeps: int) -> list[Track]:
    """Test sweeps over a simulated material that is not on the map."""
    return replay(localizer, recording_of(simulate_scan(material, seed, "test", sweeps=sweeps)))


def from_contact(track: Track, flags: np.ndarray) -> np.ndarray:
    """The ``flags`` (n,) of a track from contact on; all of them where it has none."""
    return flags[track.row >= track.contact[0]]


def decisions(track: Track, criteria: ConvergenceCriteria) -> np.ndarray:
    """Whether each entry of a track, (n,) bool, would have converged under other criteria."""
    convergence = Convergence(criteria)
    flags = np.zeros(len(track), dtype=bool)
    before = 0.0
    for index, (updated, moved) in enumerate(zip(track.updated, track.moved, strict=True)):
        if updated:
            # The reason for not converging does not matter here: everything not near counts as off the map.
            convergence.update(float(track.probability[index]), 1.0, 0.0, float(moved - before))
            before = float(moved)
        flags[index] = convergence.converged
    return flags


def curve_table(points: Sequence[CurvePoint], default: float) -> Table:
    """Table with a row per threshold; that of the configuration is marked."""
    rows = [
        (
            f"{point.probability:g}{' *' if point.probability == default else ''}",
            *(f"{100 * fraction:.1f}" for fraction in point.within),
            f"{point.median_m * MM:.1f}" if np.isfinite(point.median_m) else "",
            *(
                f"{100 * fraction:.1f}"
                for fraction in (
                    point.before,
                    point.blank,
                    point.featureless,
                    point.seam_sweeps,
                    point.seam_strains,
                )
            ),
        )
        for point in points
    ]
    columns = (
        "convergence_probability",
        *(f"within {travel * MM:g} mm, %" for travel in WITHIN_M),
        "median, mm",
        "before contact, %",
        "blank, %",
        "featureless, %",
        "seam, % of sweeps",
        "seam, % of strains",
    )
    note = (
        "Travel from contact to convergence, over the scanned feature; then false convergence: before "
        "contact, in sweeps that end before the feature, over material without a feature, and from contact "
        "with a seam that is not on the map; *: the configuration's threshold."
    )
    return Table("Early against false convergence", columns, rows, note)


def curve_figure(points: Sequence[CurvePoint], default: float) -> Figure:
    """Figure of early against false convergence, a point per threshold."""
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    curve, thresholds = figure.subplots(1, 2)
    false = [100 * point.seam_strains for point in points]
    for column, travel in enumerate(WITHIN_M):
        fractions = [100 * point.within[column] for point in points]
        (line,) = curve.plot(false, fractions, "o-", ms=4, label=f"within {travel * MM:g} mm of contact")
        for point, x, y in zip(points, false, fractions, strict=True):
            place = {"xytext": (4, 4), "textcoords": "offset points", "size": 7}
            curve.annotate(f"{point.probability:g}", (x, y), **place)
            if point.probability == default:
                curve.plot(x, y, "o", ms=11, mfc="none", mec=line.get_color())
    curve.margins(x=0.1)  # for the label of the last point
    curve.set_xlabel("falsely converged strains on a seam, %")
    curve.set_ylabel("converged sweeps over the feature, %")
    curve.set_ylim(-3.0, 110.0)
    complement = [1.0 - point.probability for point in points]
    for label, name in (
        ("before contact", "before"),
        ("blank sweeps", "blank"),
        ("featureless sweeps", "featureless"),
        ("seam sweeps", "seam_sweeps"),
        ("seam strains", "seam_strains"),
    ):
        thresholds.plot(complement, [100 * getattr(point, name) for point in points], "o-", ms=4, label=label)
    thresholds.axvline(1.0 - default, color="0.5", ls=":", label="configuration")
    thresholds.set_xscale("log")
    thresholds.invert_xaxis()
    thresholds.set_xticks(complement, [f"{point.probability:g}" for point in points], fontsize=8)
    thresholds.minorticks_off()
    thresholds.set_xlabel("convergence_probability")
    thresholds.set_ylabel("false convergence, %")
    for plot in (curve, thresholds):
        plot.grid(color="0.92")
        plot.legend(fontsize=7)
    return figure


def _travel_to(track: Track, flags: np.ndarray) -> float | None:
    """Travel from contact to the first of the ``flags``, m; ``None``: not by the feature's end."""
    at = np.flatnonzero(flags & (track.row <= track.contact[1]))
    return float(travel_from_contact(track)[at[0]]) if len(at) else None


def _point(parts: Sequence[dict[str, Any]]) -> CurvePoint:
    """The results of all conditions under one threshold."""

    def fraction(name: str) -> float:
        flags = [flag for part in parts for flag in part[name]]
        return float(np.mean(flags)) if flags else np.nan

    to_convergence = np.array(
        [np.inf if travel is None else travel for part in parts for travel in part["travel_m"]],
        dtype=np.float64,
    )
    median = float(np.median(to_convergence))
    return CurvePoint(
        parts[0]["probability"],
        tuple(float(np.mean(to_convergence <= travel)) for travel in WITHIN_M),
        median if np.isfinite(median) else np.nan,
        float(np.mean(to_convergence < 0.0)),
        *(fraction(name) for name in ("blank", "featureless", "seam_sweeps", "seam_strains")),
    )


def main() -> None:
    """Measure the curve, print the table and draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--features", nargs="+", choices=SIMULATED_FEATURES, default=SIMULATED_FEATURES)
    parser.add_argument("--sweeps", type=int, default=9)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("out/convergence"))
    args = parser.parse_args()
    end_as_by_interrupt()
    conditions = [
        SimulatedCondition(name, seed, args.sweeps, args.sweeps)
        for name in args.features
        for seed in range(1, args.seeds + 1)
    ]
    configuration = Configuration()
    with progress_bars() as progress:
        points = convergence_curve(
            conditions, configuration, args.out / "tasks", Workers(args.jobs), progress
        )
    print_tables([curve_table(points, configuration.convergence_probability)])
    save_figures({"convergence": curve_figure(points, configuration.convergence_probability)}, args.out)
    print(f"{args.out}/convergence.png")


if __name__ == "__main__":
    main()
