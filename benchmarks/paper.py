"""The paper's figures and findings, checked on its measurement models and on the default.

    scripts/in_env python benchmarks/paper.py [--seeds N] [--sweeps N] [--jobs N] [--out DIR]

For bump, snap and grommet and each seed (5) it localizes on 18 test sweeps and 18 sweeps that end before the
feature, with the default, the paper's four models as the paper has them (75 particles, 10 of them random at
each update, its hand-set widths) and the same models with the exact filter. It prints the false alarms of
the paper's plain convergence criteria (III-D) and its qualitative findings, each *held*, *not held*, or
*open* where the 95 % confidence interval over sweeps allows both, and draws the paper's Fig. 5 and 8 into DIR
(out/paper). Results of tasks are kept there; an interrupted run resumes.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from evaluation.comparison import Results, as_array, evaluate
from evaluation.conditions import SimulatedCondition
from evaluation.confidence_interval import Interval, mean_interval
from evaluation.jobs import Workers
from evaluation.methods import exact_form, paper_form, standard_methods
from evaluation.report import save_figures
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from paper_outcome import TRAVEL_BINS_M, localize

from tactile_localizer.cli.interrupts import end_as_by_interrupt
from tactile_localizer.cli.progress import progress_bars
from tactile_localizer.cli.tables import print_tables
from tactile_localizer.offline.axes import MM, display_units, label_axis, literal
from tactile_localizer.offline.table import Table
from tactile_localizer.sim.material import SIMULATED_FEATURES

TENTH_INCH = 0.00254
"""m, the paper's mean error on contact."""

HELD, NOT_HELD, OPEN = "held", "not held", "open"

SUM, FEATURELESS = paper_form("sum_of_gaussians"), paper_form("featureless")
SUM_EXACT, FEATURELESS_EXACT = exact_form("sum_of_gaussians"), exact_form("featureless")
GAUSSIAN, INDEPENDENT = paper_form("gaussian"), paper_form("gaussian_independent")

_SIZE = (4.8, 3.4)
_STYLES = {
    GAUSSIAN: ("Gaussian", "tab:red"),
    INDEPENDENT: ("Gaussian, fingers apart", "tab:orange"),
    SUM: ("sum of Gaussians", "tab:blue"),
    FEATURELESS: ("featureless apart", "tab:green"),
    "default": ("default", "black"),
}
_FIG_5 = {GAUSSIAN: ":", INDEPENDENT: "--", SUM: "-"}
_FIG_8 = {FEATURELESS: "-", SUM: "--"}
"""Lines as the paper draws them."""

_MIN_FRACTION = 1 / 3
"""Fraction of the sweeps that must cross a stretch for their mean to be drawn."""

_ALIKE = 0.25
"""Share of the error up to which two methods count as alike."""

_DETECTED = 0.95
"""Share of the sweeps over a feature in which a likelihood has to be reached to count as high."""


@dataclass(frozen=True)
class Finding:
    """A statement of the paper, checked on the results.

    ``verdict`` is :data:`HELD`, :data:`NOT_HELD`, or :data:`OPEN` where the confidence interval allows both.
    """

    statement: str
    source: str
    verdict: str
    numbers: str


def check_findings(results: Results) -> list[Finding]:
    """Every finding that the methods in the results allow to check."""
    checks: list[tuple[Callable[[Results], Finding], tuple[str, ...]]] = [
        (_within_a_tenth_of_an_inch, ("default",)),
        (_gaussians_alike_before_contact, (GAUSSIAN, INDEPENDENT)),
        (_zero_covariance_is_better, (GAUSSIAN, INDEPENDENT)),
        (_gaussian_error_grows_past_the_edge, (GAUSSIAN,)),
        (_sum_alike_at_first_contact, (SUM, GAUSSIAN)),
        (_sum_better_past_the_edge, (SUM, GAUSSIAN)),
        (_plain_criteria_fire_falsely, (GAUSSIAN, INDEPENDENT, SUM)),
        (_featureless_no_worse, (SUM, FEATURELESS)),
        (_featureless_broader_before_contact, (SUM, FEATURELESS)),
        (_featureless_broader_before_contact_exactly, (SUM_EXACT, FEATURELESS_EXACT)),
        (_probability_does_not_fire_falsely, ("default",)),
        (_motion_alone_past_the_feature, ("default",)),
        (_injection_forgets_past_the_feature, (SUM,)),
    ]
    have = set(results.methods)
    return [check(results) for check, needs in checks if have.issuperset(needs)]


@dataclass(frozen=True)
class FalseAlarms:
    """How often a criterion fires before it may.

    Parameters
    ----------
    threshold : m2 of the trace, nats of the likelihood; NaN: built in
    before : share of the sweeps over a feature in which it fires before contact
    blank : share of the sweeps that never reach a feature in which it fires; NaN without such sweeps
    """

    threshold: float
    before: float
    blank: float


def plain_criteria(results: Results, method: str) -> dict[str, FalseAlarms]:
    """The paper's plain criteria (III-D): low trace alone, and high marginal likelihood alone.

    The trace has to fall to what convergence asks for; the likelihood to rise to what it reaches after
    contact in 95 % of the sweeps.
    """
    narrow = float(results.tasks[method][0]["narrow_trace_m2"])
    reached = results.values(method, "highest_marginal_contact")
    likely = float(np.nanquantile(reached, 1.0 - _DETECTED)) if np.isfinite(reached).any() else np.inf
    traces = [results.values(method, "lowest_trace_before_m2"), _of_blanks(results, method, "lowest_trace")]
    heights = [
        results.values(method, "highest_marginal_before"),
        _of_blanks(results, method, "highest_marginal"),
    ]
    return {
        "low trace": FalseAlarms(narrow, *(_share(trace <= narrow) for trace in traces)),
        "high likelihood": FalseAlarms(likely, *(_share(height >= likely) for height in heights)),
    }


def _of_blanks(results: Results, method: str, name: str) -> np.ndarray:
    ending = "_m2" if name == "lowest_trace" else ""
    return as_array([blank[f"{name}_blank{ending}"] for blank in results.blanks(method)])


def own_criterion(results: Results, method: str) -> FalseAlarms:
    """False alarms of the package's own criterion: a probability, held over a distance."""
    before = results.values(method, "converged_before")
    return FalseAlarms(np.nan, _share(before), _share([b["converged"] for b in results.blanks(method)]))


def _share(flags: object) -> float:
    array = np.asarray(flags, dtype=float)
    return float(array.mean()) if len(array) else float("nan")


def _within_a_tenth_of_an_inch(results: Results) -> Finding:
    return _greater(
        "The feature is localised to within one tenth of an inch on contact.",
        "Abstract",
        TENTH_INCH - results.values("default", "error_contact_m"),
        "2.54 mm less the mean error from contact to the feature's end, default",
    )


def _gaussians_alike_before_contact(results: Results) -> Finding:
    return _alike(
        "Before contact, both Gaussian models perform about equally well.",
        "III-B, Fig. 5",
        results.values(INDEPENDENT, "error_before_m"),
        results.values(GAUSSIAN, "error_before_m"),
        "error before contact, no covariance between fingers less full covariance",
    )


def _zero_covariance_is_better(results: Results) -> Finding:
    return _greater(
        "After contact there is a small advantage to no covariance between the fingers.",
        "III-B, Fig. 5",
        results.values(GAUSSIAN, "error_contact_m") - results.values(INDEPENDENT, "error_contact_m"),
        "error after contact, full covariance less none between fingers",
    )


def _gaussian_error_grows_past_the_edge(results: Results) -> Finding:
    curves = _after_contact(results, GAUSSIAN)
    return _greater(
        "The Gaussian model's error grows again once the edge of the feature is passed.",
        "III-B, Fig. 5",
        _mean_of_known(curves[:, 6:8]) - curves[:, 2],
        "error 15 to 20 mm after contact less that 5 to 7.5 mm after",
    )


def _sum_alike_at_first_contact(results: Results) -> Finding:
    return _alike(
        "Just at contact there is little advantage to the sum of Gaussians.",
        "III-C, Fig. 5",
        _after_contact(results, SUM)[:, 0],
        _after_contact(results, GAUSSIAN)[:, 0],
        "error over the first 2.5 mm after contact, sum of Gaussians less Gaussian",
    )


def _sum_better_past_the_edge(results: Results) -> Finding:
    gaussian, of_sum = (_mean_of_known(_after_contact(results, method)[:, 2:]) for method in (GAUSSIAN, SUM))
    return _greater(
        "After that, the sum of Gaussians localises better than the Gaussian model.",
        "III-C, Fig. 5",
        gaussian - of_sum,
        "error from 5 mm after contact on, Gaussian less sum of Gaussians",
    )


def _plain_criteria_fire_falsely(results: Results) -> Finding:
    worst: dict[str, float] = {}
    shares = []
    for method in (GAUSSIAN, INDEPENDENT, SUM):
        for name, alarms in plain_criteria(results, method).items():
            share = float(np.nanmax([alarms.before, alarms.blank]))
            worst[name] = max(worst.get(name, 0.0), share)
            shares.append(f"{name}, {method}: {share:.0%}")
    return Finding(
        "Low covariance alone or high likelihood alone falsely signal convergence before contact.",
        "III-D",
        HELD if min(worst.values()) > 0 else NOT_HELD,
        f"sweeps in which it fires before contact, or blank ones: {'; '.join(shares)}",
    )


def _featureless_no_worse(results: Results) -> Finding:
    return _alike(
        "Modelling featureless regions apart leaves the error about the same.",
        "III-D, Fig. 8a",
        results.values(FEATURELESS, "error_contact_m"),
        results.values(SUM, "error_contact_m"),
        "error after contact, featureless less sum of Gaussians",
    )


def _featureless_broader_before_contact(results: Results) -> Finding:
    return _broader(results, FEATURELESS, SUM, "")


def _featureless_broader_before_contact_exactly(results: Results) -> Finding:
    return _broader(results, FEATURELESS_EXACT, SUM_EXACT, " (exact filter, nothing injected)")


def _broader(results: Results, featureless: str, other: str, how: str) -> Finding:
    return _greater(
        f"Modelling featureless regions apart keeps the belief broader before contact{how}.",
        "III-D, Fig. 8b",
        results.values(featureless, "trace_before_m2") - results.values(other, "trace_before_m2"),
        "covariance trace before contact, featureless less sum of Gaussians",
        unit="mm2",
    )


def _probability_does_not_fire_falsely(results: Results) -> Finding:
    alarms = own_criterion(results, "default")
    blanks = len(results.blanks("default"))
    held = blanks > 0 and alarms.blank == 0.0
    in_blanks = f"in {alarms.blank:.1%} of {blanks} blank sweeps and " if blanks else ""
    return Finding(
        "Convergence is recognized without false alarms where no feature is (this package's criterion).",
        "III-D, aim",
        HELD if held else OPEN if not blanks else NOT_HELD,
        f"fires {in_blanks}in {alarms.before:.1%} of sweeps before contact",
    )


def _motion_alone_past_the_feature(results: Results) -> Finding:
    return _greater(
        "Past the feature the error grows no faster than the motion noise (default).",
        "III, motivation",
        _below_motion(results, "default"),
        "what motion alone makes of the error at the feature's end, less the error past it",
    )


def _injection_forgets_past_the_feature(results: Results) -> Finding:
    return _greater(
        "Past the feature constant injection forgets faster than the motion noise (the paper's form).",
        "III-B",
        -_below_motion(results, SUM),
        "the error past the feature, less what motion alone makes of that at its end",
    )


def _below_motion(results: Results, method: str) -> np.ndarray:
    """How much smaller than by motion alone the error is past the feature, one a sweep, m."""
    sweeps = results.sweeps(method)
    error, motion = (
        np.array([as_array(sweep[name]) for sweep in sweeps]) for name in ("error_past_m", "motion_past_m")
    )
    return _mean_of_known(motion - error)


def _after_contact(results: Results, method: str) -> np.ndarray:
    return np.array([as_array(sweep["error_after_contact_m"]) for sweep in results.sweeps(method)])


def _mean_of_known(rows: np.ndarray) -> np.ndarray:
    """Mean of the finite entries of each row; NaN for a row without."""
    known = np.isfinite(rows)
    with np.errstate(invalid="ignore"):
        return np.where(known, rows, 0.0).sum(axis=1) / known.sum(axis=1)


def _greater(statement: str, source: str, difference: np.ndarray, what: str, unit: str = "mm") -> Finding:
    interval = mean_interval(difference)
    verdict = (
        OPEN if interval is None else HELD if interval.low > 0 else NOT_HELD if interval.high < 0 else OPEN
    )
    return Finding(statement, source, verdict, f"{what}: {_mm(interval, unit)}")


def _alike(statement: str, source: str, first: np.ndarray, second: np.ndarray, what: str) -> Finding:
    """Alike when the mean difference is surely within a quarter of the second's mean."""
    interval = mean_interval(first - second)
    if interval is None:
        return Finding(statement, source, OPEN, f"{what}: not known")
    margin = _ALIKE * float(np.nanmean(second))
    if -margin <= interval.low and interval.high <= margin:
        verdict = HELD
    else:
        verdict = NOT_HELD if interval.low > margin or interval.high < -margin else OPEN
    return Finding(
        statement, source, verdict, f"{what}: {_mm(interval)}; alike is within {margin * 1e3:.2f} mm"
    )


def _mm(interval: Interval | None, unit: str = "mm") -> str:
    if interval is None:
        return "not known"
    scale = 1e6 if unit == "mm2" else 1e3
    mean, low, high = (value * scale for value in interval)
    return f"{mean:+.2f} {unit} (95 %: {low:+.2f} to {high:+.2f})"


def error_along_sweep(results: Results, condition: str) -> Figure:
    """Error as a function of the position on the sweep axis, averaged over the sweeps (paper, Fig. 5)."""
    figure = Figure(figsize=_SIZE, layout="constrained")
    plot = figure.add_subplot()
    _draw_curves(plot, results, condition, _FIG_5, "error_curve_m", MM)
    _label(plot, results, condition, "mean error, mm")
    figure.suptitle(f"{literal(condition)}: error along the sweep", fontsize=10)
    return figure


def error_and_trace(results: Results, condition: str) -> Figure:
    """Error and covariance trace, with and without featureless regions apart (paper, Fig. 8)."""
    figure = Figure(figsize=(_SIZE[0], 1.6 * _SIZE[1]), layout="constrained")
    error, trace = figure.subplots(2, 1, sharex=True)
    for plot, name, scale in ((error, "error_curve_m", MM), (trace, "trace_curve_m2", MM**2)):
        _draw_curves(plot, results, condition, _FIG_8, name, scale)
    _label(error, results, condition, "mean error, mm", named=False)
    _label(trace, results, condition, "mean covariance trace, mm²", inches=False)
    figure.suptitle(f"{literal(condition)}: featureless regions apart", fontsize=10)
    return figure


def error_past_feature(results: Results) -> Figure:
    """Error over the travel since the feature's end, beside what motion alone makes of that at its end."""
    figure = Figure(figsize=_SIZE, layout="constrained")
    plot = figure.add_subplot()
    along = (TRAVEL_BINS_M[:-1] + TRAVEL_BINS_M[1:]) / 2 * MM
    for method, label in (("default", "default"), (SUM, "constant injection (paper's form)")):
        if method not in results.methods:
            continue
        colour = _STYLES[method][1]
        for name, style, what in (("error_past_m", "o-", label), ("motion_past_m", ":", "by motion alone")):
            curves = np.array([as_array(sweep[name]) for sweep in results.sweeps(method)])
            drawn, mean = _mean_curve(curves)
            plot.plot(along[drawn], MM * mean, style, ms=4, color=colour, label=what)
    plot.set_xlim(left=0)
    plot.set_ylim(bottom=0)
    plot.set_xlabel("travel since the feature's end, mm")
    plot.set_ylabel("mean error, mm")
    plot.grid(color="0.9")
    plot.legend(fontsize=8)
    return figure


def _draw_curves(
    plot: Axes, results: Results, condition: str, lines: Mapping[str, str], name: str, scale: float
) -> None:
    axis, centres = sweep_axis(results, condition)
    for method, style in lines.items():
        curves = np.array([as_array(sweep[name]) for sweep in results.sweeps(method, condition)])
        drawn, mean = _mean_curve(curves)
        label, colour = _STYLES[method]
        plot.plot(display_units(axis, centres[drawn]), scale * mean, style, color=colour, label=label)
    sweeps = results.sweeps(next(iter(lines)), condition)
    contacts = [sweep["contact_m"] for sweep in sweeps if sweep["contact_m"] is not None]
    if contacts:
        first, last = display_units(axis, np.mean(contacts, axis=0))
        plot.axvspan(first, last, color="0.93", zorder=0, label="feature felt (mean)")


def sweep_axis(results: Results, condition: str) -> tuple[str, np.ndarray]:
    """Axis of a condition's sweeps, and the centres of the bins of the curves along it."""
    first = next(i for i, tried in enumerate(results.conditions) if tried.name == condition)
    task = results.tasks[next(iter(results.methods))][first]
    edges = np.array(task["edges_m"])
    return task["axis"], (edges[:-1] + edges[1:]) / 2


def _mean_curve(curves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which stretches enough of the sweeps (n, stretches) are in, and their means there."""
    counts = np.isfinite(curves).sum(axis=0)
    drawn = counts >= max(1.0, _MIN_FRACTION * len(curves))
    return drawn, np.nansum(curves[:, drawn], axis=0) / counts[drawn]


def _label(
    plot: Axes, results: Results, condition: str, what: str, *, inches: bool = True, named: bool = True
) -> None:
    label_axis(plot, "x", sweep_axis(results, condition)[0], inches=inches, label=named)
    plot.set_ylim(bottom=0)
    plot.set_ylabel(what)
    plot.grid(color="0.9")
    plot.legend(fontsize=7)


def paper_figures(results: Results) -> dict[str, Figure]:
    """Fig. 5 and 8 of every condition, and the error past the feature, by the names of their files."""
    figures = {}
    for condition in results.condition_names:
        figures[f"fig5_{condition}"] = error_along_sweep(results, condition)
        figures[f"fig8_{condition}"] = error_and_trace(results, condition)
    return {**figures, "past": error_past_feature(results)}


def criteria_table(results: Results) -> Table:
    """False alarms of the paper's plain criteria beside those of the default criterion."""
    rows = []
    for method in results.methods:
        own = own_criterion(results, method)
        rows.append((method, "probability", "", _percent(own.before), _percent(own.blank)))
        for name, alarms in plain_criteria(results, method).items():
            low_trace = name == "low trace"
            threshold = f"{alarms.threshold * 1e6:.3g} mm²" if low_trace else f"{alarms.threshold:.3g} nats"
            rows.append(("", name, threshold, _percent(alarms.before), _percent(alarms.blank)))
    note = (
        "Low trace: as small as convergence requires. High likelihood: the highest threshold that is reached "
        "after contact in 95 % of the sweeps."
    )
    columns = ("method", "criterion", "threshold", "before contact", "blank sweeps")
    return Table("False alarms", columns, rows, note)


def findings_table(results: Results) -> Table:
    """The verdict on each finding."""
    rows = [(f.verdict, f.statement, f.source, f.numbers) for f in check_findings(results)]
    note = "Judged by the 95 % confidence interval over sweeps; open: it allows both."
    return Table("Findings of the paper", ("verdict", "statement", "section", "numbers"), rows, note)


def _percent(fraction: float) -> str:
    return f"{fraction * 100:.1f} %" if np.isfinite(fraction) else ""


def main() -> None:
    """Evaluate, print the tables and draw the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--sweeps", type=int, default=18)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("out/paper"))
    args = parser.parse_args()
    end_as_by_interrupt()
    conditions = [
        SimulatedCondition(name, seed, args.sweeps, args.sweeps)
        for name in SIMULATED_FEATURES
        for seed in range(1, args.seeds + 1)
    ]
    methods = [own for name, own in standard_methods().items() if name == "default" or "-paper" in name]
    with progress_bars() as progress:
        results = evaluate(conditions, methods, args.out / "tasks", Workers(args.jobs), progress, localize)
    print_tables([criteria_table(results), findings_table(results)])
    save_figures(paper_figures(results), args.out)
    print(f"{args.out}: {', '.join(paper_figures(results))}")


if __name__ == "__main__":
    main()
