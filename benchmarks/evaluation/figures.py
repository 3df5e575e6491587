"""Figures of an evaluation: error of all methods, and convergence along the travel."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from evaluation.comparison import Results
from evaluation.methods import TENTH_INCH_MM
from evaluation.tables import by_feature
from tactile_localizer.offline.axes import MM, literal

_SIZE = (4.8, 3.4)
_COLOURS = ("tab:blue", "tab:orange", "tab:green", "tab:red", "tab:purple")
_EARLIEST_MM, _LATEST_MM = -10.0, 30.0
_CURVES = 8
"""Most methods whose convergence is drawn; more curves cannot be distinguished."""


def evaluation_figures(results: Results) -> dict[str, Figure]:
    """Figures of an evaluation by file name."""
    featured, _ = by_feature(results)
    figures = {"methods": errors_of_methods(featured or results)}
    if featured is not None:
        figures["convergence"] = convergence(featured)
    return figures


def errors_of_methods(results: Results) -> Figure:
    """Mean error of every method on every condition, with its confidence interval."""
    names, conditions = list(results.methods), results.condition_names
    quantity, what = results.compared_error()
    figure = Figure(figsize=(1.3 * _SIZE[0], 1.2 + 0.34 * len(names)), layout="constrained")
    plot = figure.add_subplot()
    for shift, condition in enumerate(conditions):
        rows = np.arange(len(names)) + 0.22 * (shift - (len(conditions) - 1) / 2)
        found = [results.interval(method, quantity, condition) or (np.nan,) * 3 for method in names]
        mean, low, high = MM * np.array(found).T
        colour = _COLOURS[shift % len(_COLOURS)]
        plot.errorbar(
            mean,
            rows,
            xerr=[mean - low, high - mean],
            fmt="o",
            ms=4,
            capsize=2,
            color=colour,
            label=literal(condition),
        )
    plot.axvline(TENTH_INCH_MM, color="0.4", ls="--", lw=1, label="0.1 inch")
    plot.set_yticks(range(len(names)), names, fontsize=8)
    plot.invert_yaxis()
    plot.set_xlim(left=0)
    plot.set_xlabel(f"mean error {what}, mm")
    plot.grid(axis="x", color="0.9")
    plot.legend(fontsize=8)
    return figure


def convergence(results: Results) -> Figure:
    """Fraction of converged sweeps over the travel from contact, for the first :data:`_CURVES` methods."""
    figure = Figure(figsize=_SIZE, layout="constrained")
    plot = figure.add_subplot()
    for method in list(results.methods)[:_CURVES]:
        travel = np.sort(results.values(method, "travel_to_convergence_m")) * MM
        travel = travel[np.isfinite(travel)]
        fraction = np.arange(len(travel) + 1) / max(len(results.sweeps(method)), 1)
        along = np.concatenate([[min([_EARLIEST_MM, *travel])], travel, [_LATEST_MM]])
        plot.step(along, [*fraction, fraction[-1]], where="post", label=literal(method))
    plot.axvline(0.0, color="0.6", lw=0.8)
    plot.set_xlim(_EARLIEST_MM, _LATEST_MM)
    plot.set_ylim(0.0, 1.02)
    plot.set_xlabel("travel since contact, mm")
    plot.set_ylabel("fraction of sweeps converged")
    plot.grid(color="0.9")
    plot.legend(fontsize=8)
    return figure
