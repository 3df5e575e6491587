"""Localization on simulated features, with scenes that give no kernel widths.

    scripts/in_env python benchmarks/features.py [--seeds 81 82 83] [--no-region] [--json FILE]

For each seed and feature a localizer is built from a simulated training scan and the shipped scene without
its parameters, with ``--no-region`` also without the feature's region. It is tried on 18 test sweeps over the
feature, 18 blank sweeps that end before it, and, for what no scan has shown, 18 sweeps over a seam and 18
over material without a feature, the whole way; it is reset at the start of each. A row is a seed and a
feature, and has

``error_mm``
    mean over the sweeps of the mean error from contact to the feature's end, mm
``coverage``, ``coverage_contact``
    share of the strains whose 95 % region holds the truth, over whole sweeps and from contact to the
    feature's end; mean over the sweeps
``within_5_mm``, ``within_10_mm``
    share of the sweeps that converge at most so far past contact; at ``false_before`` of them it was before
``false_blank``, ``false_before``, ``false_none``
    how many blank sweeps, sweeps over the feature before contact, and sweeps over featureless material ever
    converge
``seam_strains``, ``seam_sweeps``
    share of the strains after contact with the seam that are converged, and of the sweeps with such a strain
``past_mm``
    mean error past the feature's end less what motion alone would make of the error there, mm
``choosing_s``, ``update_us``
    processor time of building the localizer, s; median of a measurement update, us

The file of ``--json`` has ``arguments``, ``rows`` and ``totals``: over all rows, of each feature, of each
seed. Errors, shares and times are averaged, counts are summed.
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
from convergence import UNSCANNED, from_contact, unscanned_tracks
from evaluation.conditions import SimulatedCondition
from evaluation.outcome import sweep_outcome
from paper_outcome import past_feature
from rows import Row, in_parallel, print_rows, write_rows

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.io.configuration_file import load_configuration
from tactile_localizer.offline.metrics import timing
from tactile_localizer.offline.replay import Track, replay
from tactile_localizer.scene import Scene
from tactile_localizer.sim.material import SIMULATED_FEATURES


def measure_feature(
    feature: str, seed: int, configuration: Configuration, region: bool, sweeps: int
) -> list[Row]:
    """The row of one seed and feature."""
    material = SimulatedCondition(feature, seed, sweeps, sweeps).load()
    assert material.blank is not None
    scene = bare(material.scene, region)
    began = time.process_time()
    localizer = build_localizer(material.scan, scene, configuration, np.random.default_rng(seed))
    choosing_s = time.process_time() - began
    tracks = replay(localizer, material.recording, clock=time.thread_time)
    blanks = replay(localizer, material.blank)
    seam, nothing = (
        [from_contact(track, track.converged) for track in unscanned_tracks(localizer, name, seed, sweeps)]
        for name in UNSCANNED
    )
    return [
        {
            "seed": seed,
            "feature": feature,
            "sweeps": sweeps,
            **on_feature(scene, tracks),
            "false_blank": sum(bool(track.converged.any()) for track in blanks),
            "false_none": sum(bool(sweep.any()) for sweep in nothing),
            "seam_strains": float(np.mean(np.concatenate(seam))),
            "seam_sweeps": float(np.mean([sweep.any() for sweep in seam])),
            "choosing_s": choosing_s,
            "update_us": timing(tracks)["update_median_us"],
        }
    ]


def bare(scene: Scene, region: bool) -> Scene:
    """The scene without parameters of the measurement model, with ``region`` with its feature's region."""
    return replace(scene, measurement={}, feature=scene.feature if region else None)


def on_feature(scene: Scene, tracks: Sequence[Track]) -> Row:
    """The measures of the sweeps over the feature."""
    outcomes = [{**sweep_outcome(scene, track), **past_feature(scene, track)} for track in tracks]

    def of(name: str) -> np.ndarray:
        return np.array([np.nan if one[name] is None else one[name] for one in outcomes], dtype=float)

    travel = of("travel_to_convergence_m")
    past = [
        error - motion
        for one in outcomes
        for error, motion in zip(one["error_past_m"], one["motion_past_m"], strict=True)
        if error is not None and motion is not None
    ]
    return {
        "error_mm": 1e3 * float(np.nanmean(of("error_contact_m"))),
        "coverage": float(np.nanmean(of("coverage"))),
        "coverage_contact": float(np.nanmean(of("coverage_contact"))),
        "within_5_mm": float(np.mean(travel <= 0.005)),
        "within_10_mm": float(np.mean(travel <= 0.010)),
        "false_before": sum(one["converged_before"] for one in outcomes),
        "past_mm": 1e3 * float(np.mean(past)),
    }


_COUNTS = ("false_blank", "false_before", "false_none", "sweeps")
_COLUMNS = {
    "error_mm": ("error, mm", ".2f"),
    "coverage": ("cover", ".3f"),
    "coverage_contact": ("cover, contact", ".3f"),
    "within_5_mm": ("in 5 mm", ".3f"),
    "within_10_mm": ("in 10 mm", ".3f"),
    "false_blank": ("false, blank", "d"),
    "false_before": ("false, before", "d"),
    "false_none": ("false, none", "d"),
    "seam_strains": ("seam, strains", ".3f"),
    "seam_sweeps": ("seam, sweeps", ".3f"),
    "past_mm": ("past, mm", ".2f"),
    "choosing_s": ("choosing, s", ".1f"),
    "update_us": ("update, us", ".0f"),
}
_COMMON = {
    "coverage": ".93-.97",
    "coverage_contact": ">= .90",
    "within_10_mm": ">= .95",
    "false_blank": "0",
    "false_before": "0",
    "seam_strains": "<= .05",
}
_ASKED = {"all": {"error_mm": "<= 2.0", **_COMMON}, "feature": {"error_mm": "<= 2.3"}, "seed": _COMMON}


def totals(rows: Sequence[Row]) -> list[Row]:
    """Over all rows, of each feature, of each seed: counts summed, other measures averaged."""
    groups: list[tuple[Row, list[Row]]] = [({"over": "all"}, list(rows))]
    for over in ("feature", "seed"):
        for value in dict.fromkeys(row[over] for row in rows):
            groups.append(({"over": over, over: value}, [row for row in rows if row[over] == value]))
    answer = []
    for what, own in groups:
        summed = {key: sum(row[key] for row in own) for key in _COUNTS}
        averaged = {key: float(np.mean([row[key] for row in own])) for key in _COLUMNS if key not in _COUNTS}
        answer.append({**what, **summed, **averaged})
    return answer


def show(rows: Sequence[Row]) -> None:
    """Print the rows, and below them the totals with what is asked for."""
    every = totals(rows)
    labelled = [{**row, "seed": row.get("seed", row["over"])} for row in every]
    groups = [row["over"] for row in every]
    ends = [over != following for over, following in zip(groups, [*groups[1:], ""], strict=True)]
    asked = [_ASKED[over] if end else {} for over, end in zip(groups, ends, strict=True)]
    print_rows(("seed", "feature", "sweeps"), _COLUMNS, rows, labelled, asked)


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
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--json", type=Path, metavar="FILE")
    given = parser.parse_args()
    configuration = load_configuration(None if given.configuration == "default" else given.configuration)
    common = configuration, not given.no_region, given.sweeps
    calls = [(feature, seed, *common) for seed in given.seeds for feature in given.features]
    rows: list[Row] = []
    for own in in_parallel(measure_feature, calls, given.jobs, "scans"):
        rows = sorted(rows + own, key=lambda row: (row["seed"], row["feature"]))
        if given.json is not None:
            write_rows(given.json, vars(given), rows, totals(rows))
    show(rows)


if __name__ == "__main__":
    main()
