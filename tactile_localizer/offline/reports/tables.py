"""Tables of an evaluation, for the terminal and for the report alike."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from tactile_localizer.offline.evaluation.comparison import Results, as_array
from tactile_localizer.offline.evaluation.confidence_interval import Interval
from tactile_localizer.offline.evaluation.findings import check_findings, own_criterion, plain_criteria
from tactile_localizer.offline.evaluation.methods import exact_of
from tactile_localizer.offline.figures.comparison import by_feature, compared_error
from tactile_localizer.offline.metrics import INCH, MARKS
from tactile_localizer.offline.reports.table import Table

_SOON = 0.005
"""m of travel after contact within which convergence counts as prompt."""

FOUND = 0.005
"""m of error up to which a start counts as found."""


def evaluation_tables(results: Results) -> list[Table]:
    """All tables; what is not known of a recording is left out."""
    featured, featureless = by_feature(results)
    compared = featured or results
    tables = [error_table(compared)]
    if featureless is not None:
        tables.append(travel_table(featureless))
    if featured is not None:
        tables += [convergence_table(featured), criteria_table(featured)]
    tables.append(quality_table(compared))
    findings = check_findings(compared)
    if findings:
        rows = [(f.verdict, f.statement, f.source, f.numbers) for f in findings]
        note = "Judged by the 95 % interval over sweeps; open: it allows both."
        tables.append(Table("Findings of the paper", ("", "statement", "where", "numbers"), rows, note))
    return tables


def error_table(results: Results) -> Table:
    """Mean error of each method with its interval, and its distance to the exact filter."""
    quantity, what = compared_error(results)
    conditions = results.condition_names
    together = len(conditions) > 1
    rows = []
    for method, tried in results.methods.items():
        intervals = [results.interval(method, quantity, condition) for condition in conditions]
        overall = results.interval(method, quantity)
        by = exact_of(tried)
        exact = results.interval(by, quantity) if by in results.methods and by != method else None
        away = "" if overall is None or exact is None else f"{(overall.mean / exact.mean - 1) * 100:+.0f} %"
        rows.append(
            (
                method,
                *map(_mm, intervals),
                *((_mm(overall),) if together else ()),
                f"{overall.mean / INCH:.3f}" if overall is not None else "",
                away,
            )
        )
    columns = (
        "method",
        *(f"{c}, mm" for c in conditions),
        *(("all, mm",) if together else ()),
        "inch",
        "to exact",
    )
    n = len(results.sweeps(next(iter(results.methods))))
    note = f"Mean {what}, 95 % interval over sweeps ({n} in all); to exact: against the same model on a grid."
    return Table("Error", columns, rows, note)


def travel_table(results: Results) -> Table:
    """Error on material without a feature, which has no contact to begin from: after some travel."""
    after = {
        (condition, method): [sweep["error_after_travel_m"] for sweep in results.sweeps(method, condition)]
        for condition in results.condition_names
        for method in results.methods
    }
    marks = [f"{mark:g}" for mark in MARKS if any(f"{mark:g}" in own[0] for own in after.values())]
    rows = []
    for (condition, method), own in after.items():
        medians = [_of(np.median, as_array([errors.get(mark) for errors in own])) for mark in marks]
        at_end = results.values(method, "final_error_m", condition)
        found, worst = float(np.mean(at_end <= FOUND)), _of(np.max, at_end)
        coverage = _of(np.mean, results.values(method, "coverage", condition))
        last = (_percent(found), _in_mm(worst), _percent(coverage))
        rows.append((condition, method, *map(_in_mm, medians), *last))
    columns = ("on", "method", *(f"{float(mark) * 1e3:g} mm" for mark in marks), "found", "worst", "coverage")
    note = (
        f"Median error, mm, after so much travel from a start; found: within {FOUND * 1e3:g} mm at the end; "
        "worst: at the end, mm; coverage of the 95 % region."
    )
    return Table("Error along the travel", columns, rows, note)


def convergence_table(results: Results) -> Table:
    """How soon and how rightly sweeps converge."""
    rows = []
    for method in results.methods:
        travel = results.values(method, "travel_to_convergence_m")
        time = results.values(method, "time_to_convergence_s")
        alarms = own_criterion(results, method)
        rows.append(
            (
                method,
                _percent(float(np.mean(results.values(method, "converged")))),
                _percent(float(np.mean(travel <= _SOON))),
                _number(_of(np.median, travel) * 1e3),
                _number(_of(_p95, travel) * 1e3),
                _number(_of(np.median, time)),
                _percent(alarms.before),
                _percent(alarms.blank),
                _number(_of(np.mean, results.values(method, "error_converged_m")) * 1e3),
            )
        )
    columns = (
        "method",
        "converged",
        "within 5 mm",
        "median, mm",
        "95 %, mm",
        "median, s",
        "before contact",
        "blank",
        "error, mm",
    )
    blanks = len(results.blanks(next(iter(results.methods))))
    note = (
        "Sweeps that converged before the feature's end; travel and time from contact; false: before it, "
        f"and in {blanks} blank sweeps that never reach a feature; mean error while converged."
    )
    return Table("Convergence", columns, rows, note)


def criteria_table(results: Results) -> Table:
    """False alarms of the paper's plain criteria beside the package's own."""
    rows = []
    for method in results.methods:
        own = own_criterion(results, method)
        rows.append((method, "probability", "", _percent(own.before), _percent(own.blank)))
        for name, alarms in plain_criteria(results, method).items():
            trace = name == "low trace"
            shown = f"{alarms.threshold * 1e6:.3g} mm²" if trace else f"{alarms.threshold:.3g} nats"
            rows.append(("", name, shown, _percent(alarms.before), _percent(alarms.blank)))
    note = (
        "Low trace: as narrow as convergence asks for. High likelihood: as high as can be while it is "
        "reached after contact in 95 % of sweeps."
    )
    return Table(
        "False alarms", ("method", "criterion", "threshold", "before contact", "blank sweeps"), rows, note
    )


def quality_table(results: Results) -> Table:
    """Calibration and time of each method."""
    rows = []
    for method in results.methods:
        median, p99 = results.times(method)
        rows.append(
            (
                method,
                _percent(_of(np.mean, results.values(method, "coverage"))),
                _percent(_of(np.mean, results.values(method, "coverage_contact"))),
                _number(_of(np.mean, results.values(method, "nees"))),
                _number(_of(np.mean, results.values(method, "nees_contact"))),
                f"{median:.0f}",
                f"{p99:.0f}",
            )
        )
    columns = ("method", "coverage", "on contact", "NEES", "on contact", "update, µs", "99 %, µs")
    note = "Share of estimates whose 95 % region holds the truth; NEES per degree of freedom (right: 1)."
    return Table("Calibration and time", columns, rows, note)


def _of(function: Callable[[np.ndarray], Any], values: np.ndarray) -> float:
    """A statistic of the finite ``values``; NaN where there are none."""
    known = values[np.isfinite(values)]
    return float(function(known)) if len(known) else np.nan


def _p95(values: np.ndarray) -> Any:
    return np.quantile(values, 0.95)


def _mm(interval: Interval | None) -> str:
    if interval is None:
        return ""
    return f"{interval.mean * 1e3:.2f} ({interval.low * 1e3:.2f}-{interval.high * 1e3:.2f})"


def _in_mm(value: float) -> str:
    return _number(value * 1e3)


def _number(value: float) -> str:
    if not np.isfinite(value):
        return ""
    return f"{value:.2f}" if abs(value) < 1000 else f"{value:.1e}"


def _percent(share: float) -> str:
    return f"{share * 100:.1f} %" if np.isfinite(share) else ""
