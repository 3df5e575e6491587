"""Tables of an evaluation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from evaluation.comparison import Results, as_array
from evaluation.confidence_interval import Interval
from evaluation.methods import exact_of
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.offline.metrics import INCH, MARKS
from tactile_localizer.offline.table import Table

_PROMPT_M = 0.005
"""Travel after contact within which convergence counts as prompt, m."""

FOUND_M = 0.005
"""Largest final error of a sweep that counts as found, m."""


def evaluation_tables(results: Results) -> list[Table]:
    """All tables for which the results have data."""
    featured, featureless = by_feature(results)
    compared = featured or results
    tables = [error_table(compared)]
    if featureless is not None:
        tables.append(travel_table(featureless))
    if featured is not None:
        tables.append(convergence_table(featured))
    tables.append(quality_table(compared))
    return tables


def by_feature(results: Results) -> tuple[Results | None, Results | None]:
    """Results on conditions with known contact, and on the others; ``None`` if there are none."""
    known = {name for name in results.condition_names if results.has_contact(name)}

    def only(keep: Callable[[str], bool]) -> Results | None:
        kept = [i for i, condition in enumerate(results.conditions) if keep(condition.name)]
        tasks = {method: [of[i] for i in kept] for method, of in results.tasks.items()}
        return Results(tuple(results.conditions[i] for i in kept), results.methods, tasks) if kept else None

    return only(known.__contains__), only(lambda name: name not in known)


def times(results: Results, method: str) -> tuple[float, float]:
    """Medians over the tasks of the median and the 99th percentile of the update time, µs."""
    of = [task["timing"] for task in results.tasks[method]]
    medians = [t["update_median_us"] for t in of if t["update_median_us"] is not None]
    if not medians:
        return np.nan, np.nan
    return float(np.median(medians)), float(np.median([t["update_p99_us"] for t in of]))


def error_table(results: Results) -> Table:
    """Mean error of each method with its confidence interval, and relative to the exact filter."""
    quantity, what = results.compared_error()
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
        "to exact filter",
    )
    n = len(results.sweeps(next(iter(results.methods))))
    note = (
        f"Mean {what}, 95 % confidence interval over {n} sweeps; to exact filter: relative to the grid "
        "filter with the same model."
    )
    return Table("Error", columns, rows, note)


def travel_table(results: Results) -> Table:
    """Error along the travel on material without contact."""
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
        found, worst = float(np.mean(at_end <= FOUND_M)), _of(np.max, at_end)
        coverage = _of(np.mean, results.values(method, "coverage", condition))
        last = (_percent(found), _in_mm(worst), _percent(coverage))
        rows.append((condition, method, *map(_in_mm, medians), *last))
    columns = (
        "condition",
        "method",
        *(f"{float(mark) * 1e3:g} mm" for mark in marks),
        "found",
        "worst",
        "coverage",
    )
    note = (
        f"Median error after the travel, mm; found: error of at most {FOUND_M * 1e3:g} mm at the end; worst: "
        "largest error at the end, mm; coverage of the 95 % region."
    )
    return Table("Error along the travel", columns, rows, note)


def convergence_table(results: Results) -> Table:
    """Travel and time to convergence, and false convergence."""
    rows = []
    for method in results.methods:
        travel = results.values(method, "travel_to_convergence_m")
        time = results.values(method, "time_to_convergence_s")
        before = results.values(method, "converged_before")
        blank = as_array([float(of["converged"]) for of in results.blanks(method)])
        rows.append(
            (
                method,
                _percent(float(np.mean(results.values(method, "converged")))),
                _percent(float(np.mean(travel <= _PROMPT_M))),
                _number(_of(np.median, travel) * 1e3),
                _number(_of(_p95, travel) * 1e3),
                _number(_of(np.median, time)),
                _percent(_of(np.mean, before)),
                _percent(_of(np.mean, blank)),
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
        "Sweeps that converged before the feature's end; travel and time from contact to convergence; false "
        f"convergence before contact and in {blanks} blank sweeps; mean error while converged."
    )
    return Table("Convergence", columns, rows, note)


def quality_table(results: Results) -> Table:
    """Consistency of the covariance and computing time of each method."""
    rows = []
    for method in results.methods:
        median, p99 = times(results, method)
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
    columns = ("method", "coverage", "in contact", "NEES", "in contact", "update, µs", "99 %, µs")
    note = (
        "Fraction of estimates whose 95 % region contains the truth; NEES per degree of freedom (ideally 1)."
    )
    return Table("Consistency and time", columns, rows, note)


def configuration_table(results: Results) -> Table:
    """Differences between the configuration of each method and the default."""
    default = asdict(Configuration())
    rows = []
    for name, method in results.methods.items():
        own = {**asdict(method.configuration), **method.measurement}
        changed = {key: value for key, value in own.items() if default.get(key) != value}
        rows.append((name, _fields(changed) or "the defaults"))
    columns = ("method", "differences from the default")
    return Table("Configurations", columns, rows, f"Default: {_fields(default)}.")


def _fields(values: dict[str, Any]) -> str:
    return ", ".join(f"{k}: {f'{v:.4g}' if isinstance(v, float) else v}" for k, v in values.items())


def _of(function: Callable[[np.ndarray], Any], values: np.ndarray) -> float:
    """Statistic of the finite ``values``; NaN if there are none."""
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


def _percent(fraction: float) -> str:
    return f"{fraction * 100:.1f} %" if np.isfinite(fraction) else ""
