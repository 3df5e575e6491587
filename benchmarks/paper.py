"""The paper's figures and findings, checked on its measurement models and on the default.

    scripts/in_env python benchmarks/paper.py [--seeds 1 2 3] [--sweeps 18] [--out DIR]

For bump, snap and grommet and each seed it localizes on test sweeps and on sweeps that end before the
feature, with the default, the paper's four models as the paper has them (75 particles, 10 of them random at
each update, its hand-set widths) and two of these with the exact filter. It prints the paper's qualitative
findings, each *held*, *not held*, or *open* where the 95 % confidence interval over sweeps allows both, with
the false alarms of its plain convergence criteria (III-D), and draws its Fig. 5 and 8 into DIR (out/paper).
"""

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from rows import Row, in_parallel

from tactile_localizer.cli.tables import print_table
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer, learn
from tactile_localizer.offline.metrics import position_error, travel_from_contact
from tactile_localizer.offline.replay import ReplayedSweep, replay
from tactile_localizer.sim import shipped_scene, simulate_recording, simulate_scan
from tactile_localizer.sim.material import SIMULATED_FEATURES

GAUSSIAN, INDEPENDENT, SUM, FEATURELESS = (
    "gaussian",
    "gaussian_independent",
    "sum_of_gaussians",
    "featureless",
)
EXACT = " exact"
"""Ending of the name of a method with the exact filter."""

_PAPER_FILTER = Configuration(
    filter="particle",
    particles=75,
    random_particles=10,
    resample_below=1.0,
)
_MODELS = {
    GAUSSIAN: "paper_models:PaperGaussian",
    INDEPENDENT: "paper_models:PaperIndependent",
    SUM: "paper_models:PaperSum",
    FEATURELESS: "paper_models:PaperFeatureless",
}
METHODS = {
    "default": Configuration(),
    **{name: replace(_PAPER_FILTER, model=model) for name, model in _MODELS.items()},
    **{name + EXACT: Configuration(model=_MODELS[name]) for name in (SUM, FEATURELESS)},
}
BINS = 40
"""Bins along the sweeps in which errors and variances are averaged."""

TENTH_INCH = 0.00254
"""m, the paper's mean error on contact."""

STRETCHES_M = np.arange(0.0, 0.0201, 0.0025)
"""Edges of the stretches after contact, m."""

_ALIKE = 0.25
"""Fraction of the error up to which two methods count as alike."""
_DETECTED = 0.95
"""Fraction of the sweeps over a feature in which a likelihood has to be reached to count as high."""
_FIGURES = {
    "Fig. 5": ("error_along", {GAUSSIAN: ":", INDEPENDENT: "--", SUM: "-"}, "mean error, mm", 1e3),
    "Fig. 8a": ("error_along", {FEATURELESS: "-", SUM: "--"}, "mean error, mm", 1e3),
    "Fig. 8b": ("trace_along", {FEATURELESS: "-", SUM: "--"}, "mean covariance trace, mm²", 1e6),
}
"""Values, methods and lines, as the paper draws them."""


class Finding(NamedTuple):
    """A statement of the paper.

    Parameters
    ----------
    statement, section : what the paper says, and where
    measured : what the difference is
    difference : of each sweep; the statement holds where its mean is above zero
    reference : error (m) a quarter of which is the margin; then the statement holds where the mean of the
        difference is within it; ``None`` otherwise
    scale : from the unit of the difference to millimetres
    """

    statement: str
    section: str
    measured: str
    difference: np.ndarray
    reference: np.ndarray | None = None
    scale: float = 1e3

    def row(self) -> tuple[str, ...]:
        """Verdict, statement, section, and the mean of the difference with its confidence interval."""
        known = self.scale * self.difference[np.isfinite(self.difference)]
        half = 1.96 * known.std(ddof=1) / np.sqrt(len(known)) if len(known) > 1 else np.inf
        low, high = known.mean() - half, known.mean() + half
        if self.reference is None:
            held, failed = low > 0, high < 0
        else:
            margin = _ALIKE * self.scale * float(np.nanmean(self.reference))
            held, failed = -margin <= low and high <= margin, low > margin or high < -margin
        verdict = "held" if held else "not held" if failed else "open"
        numbers = f"{self.measured}: {known.mean():+.2f} ({low:+.2f} to {high:+.2f})"
        return verdict, self.statement, self.section, numbers


def localize(feature: str, seed: int, sweeps: int) -> list[Row]:
    """A row for each method and sweep over the feature, or sweep that ends before it."""
    scene, scan = shipped_scene(feature), simulate_scan(feature, seed)
    calibration = learn(scan, scene)
    rows = []
    for method, configuration in METHODS.items():
        rng = np.random.default_rng(seed)
        localizer = build_localizer(scan, scene, configuration, rng, calibration=calibration)
        for reach in (True, False):
            test = simulate_recording(feature, seed, "test", sweeps=sweeps, reach_feature=reach)
            for sweep in replay(localizer, test):
                rows.append({"feature": feature, "method": method, "blank": not reach, **outcome(sweep)})
    return rows


def outcome(sweep: ReplayedSweep) -> Row:
    """Values of one sweep, m and m²; NaN where a part of the sweep has no estimate."""
    before = sweep.row < sweep.contact[0] if sweep.contact[0] >= 0 else np.ones(len(sweep), dtype=bool)
    error, trace, travel = position_error(sweep), sweep.trace, travel_from_contact(sweep)
    on_feature = sweep.on_contact
    scene = sweep.scene
    assert sweep.truth is not None
    place = np.digitize(sweep.truth[:, 0], np.linspace(scene.lower[0], scene.upper[0], BINS + 1)) - 1
    stretch = np.where(sweep.row <= sweep.contact[1], np.digitize(travel, STRETCHES_M) - 1, -1)
    return {
        "error_before": _mean(error[before]),
        "error": _mean(error[on_feature]),
        "trace_before": _mean(trace[before]),
        "after_contact": [_mean(error[stretch == index]) for index in range(len(STRETCHES_M) - 1)],
        "error_along": [_mean(error[place == index]) for index in range(BINS)],
        "trace_along": [_mean(trace[place == index]) for index in range(BINS)],
        "lowest_trace": trace[before & sweep.updated].min(initial=np.inf),
        "likelihood_before": sweep.log_marginal[before & sweep.updated].max(initial=-np.inf),
        "likelihood": sweep.log_marginal[on_feature & sweep.updated].max(initial=-np.inf),
        "converged_before": bool(sweep.converged[before].any()),
    }


def findings(values: Callable[..., np.ndarray]) -> list[Finding]:
    """The findings; ``values(method, name)`` are those of the sweeps over a feature."""

    def less(first: str, second: str, name: str) -> np.ndarray:
        return values(first, name) - values(second, name)

    def after(method: str, stretches: slice) -> np.ndarray:
        known = np.ma.masked_invalid(values(method, "after_contact")[:, stretches])
        return np.asarray(known.mean(axis=1).filled(np.nan))

    first, then = slice(0, 1), slice(2, None)
    error = "error_before"
    return [
        Finding(
            "The feature is localized to within one tenth of an inch on contact.",
            "Abstract",
            "2.54 mm less the default's error from contact to the feature's end, mm",
            TENTH_INCH - values("default", "error"),
        ),
        Finding(
            "Before contact, both Gaussian models perform about equally well.",
            "III-B, Fig. 5",
            "error before contact, fingers apart less full covariance, mm",
            less(INDEPENDENT, GAUSSIAN, error),
            values(GAUSSIAN, error),
        ),
        Finding(
            "After contact there is a small advantage to no covariance between the fingers.",
            "III-B, Fig. 5",
            "error after contact, full covariance less fingers apart, mm",
            less(GAUSSIAN, INDEPENDENT, "error"),
        ),
        Finding(
            "The Gaussian model's error grows again once the edge of the feature is passed.",
            "III-B, Fig. 5",
            "error 15 to 20 mm after contact less that 5 to 7.5 mm after, mm",
            after(GAUSSIAN, slice(6, 8)) - after(GAUSSIAN, slice(2, 3)),
        ),
        Finding(
            "Just at contact there is little advantage to the sum of Gaussians.",
            "III-C, Fig. 5",
            "error over the first 2.5 mm, sum of Gaussians less Gaussian, mm",
            after(SUM, first) - after(GAUSSIAN, first),
            after(GAUSSIAN, first),
        ),
        Finding(
            "After that, the sum of Gaussians localizes better than the Gaussian model.",
            "III-C, Fig. 5",
            "error from 5 mm after contact on, Gaussian less sum of Gaussians, mm",
            after(GAUSSIAN, then) - after(SUM, then),
        ),
        Finding(
            "Modelling featureless regions apart leaves the error about the same.",
            "III-D, Fig. 8a",
            "error after contact, featureless less sum of Gaussians, mm",
            less(FEATURELESS, SUM, "error"),
            values(SUM, "error"),
        ),
        *(
            Finding(
                f"Modelling featureless regions apart keeps the belief broader before contact{note}.",
                "III-D, Fig. 8b",
                "trace before contact, featureless less sum of Gaussians, mm²",
                less(FEATURELESS + ending, SUM + ending, "trace_before"),
                scale=1e6,
            )
            for ending, note in (("", ""), (EXACT, " (exact filter)"))
        ),
    ]


def false_alarms(rows: Sequence[Row], method: str) -> tuple[str, ...]:
    """How often the paper's plain criteria and the package's own fire before contact or in blank sweeps.

    The trace has to fall to that of a belief as narrow as convergence requires; the likelihood to rise to
    what it reaches after contact in 95 % of the sweeps.
    """
    own = [row for row in rows if row["method"] == method]
    narrow = 2 * Configuration().convergence_radius ** 2 / 9.21  # chi-square, two degrees of freedom, 0.99
    reached = [row["likelihood"] for row in own if not row["blank"]]
    likely = float(np.quantile(reached, 1.0 - _DETECTED))
    shares = [
        np.mean([row["lowest_trace"] <= narrow for row in own]),
        np.mean([row["likelihood_before"] >= likely for row in own]),
        np.mean([row["converged_before"] for row in own]),
    ]
    return method, *(f"{share:.1%}" for share in shares)


def paper_figure(rows: Sequence[Row], feature: str) -> Figure:
    """Fig. 5 and 8 of the paper on one feature."""
    figure = Figure(figsize=(13.0, 3.8), layout="constrained")
    scene = shipped_scene(feature)
    place = 1e3 * np.linspace(scene.lower[0], scene.upper[0], 2 * BINS + 1)[1::2]
    for plot, (title, (name, lines, label, scale)) in zip(
        figure.subplots(1, len(_FIGURES)), _FIGURES.items(), strict=True
    ):
        for method, style in lines.items():
            own = [
                row
                for row in rows
                if (row["feature"], row["method"], row["blank"]) == (feature, method, False)
            ]
            curves = np.array([row[name] for row in own])
            known = np.isfinite(curves).mean(axis=0) > 1 / 3
            plot.plot(place[known], scale * np.nanmean(curves[:, known], axis=0), style, label=method)
        plot.set_title(f"{feature}, {title}", size=10)
        plot.set_ylim(bottom=0)
        plot.set_xlabel("x, mm")
        plot.set_ylabel(label)
        plot.grid(color="0.9")
        plot.legend(fontsize=8)
    return figure


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else np.nan


def main() -> None:
    """Localize, print the tables and draw the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--features", nargs="+", choices=SIMULATED_FEATURES, default=SIMULATED_FEATURES)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--sweeps", type=int, default=18)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--cluster", metavar="ADDRESS", help="Dask scheduler, in place of processes")
    parser.add_argument("--out", type=Path, default=Path("out/paper"))
    given = parser.parse_args()
    calls = [(feature, seed, given.sweeps) for feature in given.features for seed in given.seeds]
    rows: list[dict[str, Any]] = [
        row for own in in_parallel(localize, calls, given.jobs, "scans", given.cluster) for row in own
    ]
    # Sweeps of all methods in the same order, so that differences are between the same sweeps.
    rows.sort(key=lambda row: given.features.index(row["feature"]))

    def values(method: str, name: str) -> np.ndarray:
        return np.array([row[name] for row in rows if row["method"] == method and not row["blank"]])

    with np.errstate(invalid="ignore"):
        checked = [finding.row() for finding in findings(values)]
    print_table(("verdict", "statement", "section", "measured"), checked)
    print("\nFalse alarms, % of all sweeps")
    alarms = [false_alarms(rows, method) for method in METHODS]
    print_table(("method", "low trace", "high likelihood", "probability"), alarms)
    given.out.mkdir(parents=True, exist_ok=True)
    for feature in given.features:
        paper_figure(rows, feature).savefig(given.out / f"{feature}.png", dpi=120)
    print(f"{given.out}/{', '.join(f'{feature}.png' for feature in given.features)}")


if __name__ == "__main__":
    main()
