"""Measures of localized sweeps whose true positions and contact with a feature are known."""

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.offline.metrics import covered, position_error, travel_from_contact
from tactile_localizer.offline.replay import ReplayedSweep

Row = dict[str, Any]

COLUMNS = {
    "error_mm": ("error", ".2f"),
    "error_settled_mm": ("settled", ".2f"),
    "coverage": ("cover", ".3f"),
    "coverage_contact": ("contact", ".3f"),
    "within_5_mm": ("in 5 mm", ".2f"),
    "within_10_mm": ("in 10 mm", ".2f"),
    "converged": ("converged", ".2f"),
    "false_sweeps": ("false sweeps", ".3f"),
    "false_strains": ("strains", ".4f"),
    "again": ("again", ".2f"),
    "set_down": ("set down", ".2f"),
    "false_before": ("before", "d"),
    "false_blank": ("blank", "d"),
    "false_none": ("none", "d"),
    "foreign_strains": ("foreign strains", ".3f"),
    "foreign_sweeps": ("sweeps", ".2f"),
    "other_strains": ("other strains", ".3f"),
    "other_sweeps": ("sweeps", ".2f"),
    "update_us": ("update, us", ".0f"),
    "update_open_us": ("open", ".0f"),
    "update_reads": ("reads", ".1f"),
    "update_open_reads": ("open", ".1f"),
    "learning_s": ("learning, s", ".1f"),
}
"""Heading and format of each measure."""

COUNTS = ("sweeps", "false_before", "false_blank", "false_none")
"""Measures that are numbers of sweeps."""

SETTLED_M = 0.004
"""Travel from contact after which an error counts as settled, m."""


def on_feature(sweeps: Sequence[ReplayedSweep]) -> Row:
    """Error, coverage and convergence of sweeps over the scanned feature.

    Errors and coverages are means over the sweeps of the mean over the strains concerned; a sweep without
    contact has none of them on contact, and all of it lies before contact.
    """
    errors = [position_error(sweep) for sweep in sweeps]
    inside = [covered(sweep) for sweep in sweeps]
    contacts = [sweep.on_contact for sweep in sweeps]
    settled = [
        during & (travel_from_contact(sweep) >= SETTLED_M)
        for sweep, during in zip(sweeps, contacts, strict=True)
    ]
    travel = np.array([_travel_to_convergence(sweep) for sweep in sweeps])
    return {
        "error_mm": 1e3 * _mean_of_sweeps(errors, contacts),
        "error_settled_mm": 1e3 * _mean_of_sweeps(errors, settled),
        "coverage": _mean_of_sweeps(inside, [np.ones(len(sweep), dtype=bool) for sweep in sweeps]),
        "coverage_contact": _mean_of_sweeps(inside, contacts),
        "within_5_mm": float(np.mean(travel <= 0.005)),
        "within_10_mm": float(np.mean(travel <= 0.010)),
        "converged": _mean_of_sweeps([sweep.converged for sweep in sweeps], contacts),
        "false_before": sum(bool((sweep.converged & ~_from_contact(sweep)).any()) for sweep in sweeps),
    }


def falsely_converged(sweeps: Sequence[ReplayedSweep], radius: float) -> Row:
    """Convergence on a wrong place: an error of more than ``radius`` m.

    ``false_sweeps`` is the share of the sweeps in which that is the case after any strain from contact on,
    ``false_strains`` the share of all converged strains.
    """
    wrong = [sweep.converged & (position_error(sweep) > radius) for sweep in sweeps]
    converged = sum(int(sweep.converged.sum()) for sweep in sweeps)
    return {
        "false_sweeps": float(
            np.mean(
                [(flags & _from_contact(sweep)).any() for flags, sweep in zip(wrong, sweeps, strict=True)]
            )
        ),
        "false_strains": sum(int(flags.sum()) for flags in wrong) / converged if converged else 0.0,
    }


def right_at_their_end(sweeps: Sequence[ReplayedSweep], radius: float, name: str) -> Row:
    """Share of sweeps that are converged and right at their end."""
    ends = [sweep.converged[-1] and position_error(sweep)[-1] <= radius for sweep in sweeps]
    return {name: float(np.mean(ends)) if ends else None}


def summary(rows: Sequence[Row]) -> Row:
    """Over rows: their counts summed, and the means of their other measures."""
    answer: Row = {}
    for key in (*COUNTS, *COLUMNS):
        known = [row[key] for row in rows if row.get(key) is not None]
        if known:
            answer[key] = sum(known) if key in COUNTS else float(np.mean(known))
    return answer


def standard_errors(
    measure: Callable[[Sequence[ReplayedSweep]], Row], sweeps: Sequence[ReplayedSweep]
) -> Row:
    """Standard errors of the means that ``measure`` returns, from the spread of the single sweeps."""
    return {
        key: float(np.nanstd(each, ddof=1) / np.sqrt(np.isfinite(each).sum()))
        for key, each in by_sweep(measure, sweeps).items()
    }


def by_sweep(
    measure: Callable[[Sequence[ReplayedSweep]], Row], sweeps: Sequence[ReplayedSweep]
) -> dict[str, list[float]]:
    """What ``measure`` returns of each sweep alone, by name; NaN where it is not defined."""
    rows = [measure([sweep]) for sweep in sweeps]
    return {key: [float(row[key]) for row in rows] for key in rows[0]} if rows else {}


def on_unscanned(sweeps: Sequence[ReplayedSweep], name: str = "foreign") -> Row:
    """Shares of converged strains from contact on, ``<name>_strains``, and of the sweeps with one.

    A sweep without contact counts from its start.
    """
    flags = [sweep.converged[sweep.row >= sweep.contact[0]] for sweep in sweeps]
    ever = [sweep.any() for sweep in flags]
    return {f"{name}_strains": float(np.mean(np.concatenate(flags))), f"{name}_sweeps": float(np.mean(ever))}


def ever_converged(sweeps: Sequence[ReplayedSweep]) -> int:
    """Number of sweeps in which any strain is converged."""
    return sum(bool(sweep.converged.any()) for sweep in sweeps)


def update_times(sweeps: Sequence[ReplayedSweep], read: float) -> Row:
    """Median times of measurement updates that are converged, and that are not, µs and in units of ``read``.

    Updates that do not occur have no time.
    """
    row: Row = {}
    for name, converged in (("update", True), ("update_open", False)):
        times = [sweep.seconds[sweep.updated & (sweep.converged == converged)] for sweep in sweeps]
        seconds = np.concatenate(times)
        median = 1e6 * float(np.median(seconds)) if len(seconds) else None
        row[f"{name}_us"] = median
        row[f"{name}_reads"] = None if median is None else median / read
    return row


def read_us(scan: Scan) -> float:
    """Median time of one read (the sum) of the training strains as float32, µs."""
    strain = scan.strain.astype(np.float32)
    times = []
    for _ in range(200):
        began = time.perf_counter()
        strain.sum()
        times.append(time.perf_counter() - began)
    return 1e6 * float(np.median(times))


def _from_contact(sweep: ReplayedSweep) -> np.ndarray:
    """Strains from contact on, (n,) bool; none in a sweep without contact."""
    first = sweep.contact[0]
    return (sweep.row >= first) & (first >= 0)


def _travel_to_convergence(sweep: ReplayedSweep) -> float:
    """Travel from contact to the first converged strain, m; infinite where none is by the feature's end."""
    at = np.flatnonzero(sweep.converged & (sweep.row <= sweep.contact[1]))
    return float(travel_from_contact(sweep)[at[0]]) if len(at) else np.inf


def _mean_of_sweeps(values: Sequence[np.ndarray], keep: Sequence[np.ndarray]) -> float:
    """Mean over the sweeps of the mean of the kept values; NaN where none is kept."""
    means = [own[kept].mean() for own, kept in zip(values, keep, strict=True) if kept.any()]
    return float(np.mean(means)) if means else np.nan
