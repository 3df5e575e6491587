"""Pictures of an evaluation: the paper's Fig. 5 and 8, errors of all methods, convergence."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tactile_localizer.offline.evaluation.comparison import Results, as_array
from tactile_localizer.offline.evaluation.findings import FEATURELESS, GAUSSIAN, INDEPENDENT, SUM, TENTH_INCH
from tactile_localizer.offline.evaluation.outcome import STRETCHES
from tactile_localizer.offline.figures.axes import MM, label_axis, literal, shown

_SIZE = (4.8, 3.4)
_LOOKS = {
    GAUSSIAN: ("Gaussian", "tab:red"),
    INDEPENDENT: ("Gaussian, fingers apart", "tab:orange"),
    SUM: ("sum of Gaussians", "tab:blue"),
    FEATURELESS: ("featureless apart", "tab:green"),
    "default": ("default", "black"),
}
_FIG_5 = {GAUSSIAN: ":", INDEPENDENT: "--", SUM: "-"}
_FIG_8 = {FEATURELESS: "-", SUM: "--"}
"""Lines as the paper draws them."""
_FEWEST = 1 / 3
"""Share of the sweeps that must be in a stretch for their mean to be drawn."""
_CONDITIONS = ("tab:blue", "tab:orange", "tab:green", "tab:red", "tab:purple")


def evaluation_figures(results: Results) -> dict[str, Figure]:
    """Every picture of an evaluation, by the name of the file that it belongs into."""
    have = results.methods.keys()
    featured, _ = by_feature(results)
    compared = featured or results
    figures = {}
    for condition in compared.condition_names:
        if _FIG_5.keys() <= have:
            figures[f"fig5_{condition}"] = error_along_sweep(compared, condition)
        if _FIG_8.keys() <= have:
            figures[f"fig8_{condition}"] = error_and_trace(compared, condition)
    figures["methods"] = errors_of_methods(compared)
    if featured is not None and _LOOKS.keys() & have:
        figures["convergence"] = convergence(featured)
        figures["past"] = error_past_feature(featured)
    return figures


def by_feature(results: Results) -> tuple[Results | None, Results | None]:
    """The results where it is known when a feature is touched, and those where it is not; ``None``: none."""
    felt = [name for name in results.condition_names if results.felt(name)]
    rest = [name for name in results.condition_names if name not in felt]
    return results.only(felt) if felt else None, results.only(rest) if rest else None


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


def errors_of_methods(results: Results) -> Figure:
    """Mean error of every method on every condition, with its confidence interval."""
    names, conditions = list(results.methods), results.condition_names
    quantity, what = compared_error(results)
    figure = Figure(figsize=(1.3 * _SIZE[0], 1.2 + 0.34 * len(names)), layout="constrained")
    plot = figure.add_subplot()
    for shift, condition in enumerate(conditions):
        rows = np.arange(len(names)) + 0.22 * (shift - (len(conditions) - 1) / 2)
        found = [results.interval(method, quantity, condition) or (np.nan,) * 3 for method in names]
        mean, low, high = MM * np.array(found).T
        colour = _CONDITIONS[shift % len(_CONDITIONS)]
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
    plot.axvline(TENTH_INCH * MM, color="0.4", ls="--", lw=1, label="0.1 inch")
    plot.set_yticks(range(len(names)), names, fontsize=8)
    plot.invert_yaxis()
    plot.set_xlim(left=0)
    plot.set_xlabel(f"mean error {what}, mm")
    plot.grid(axis="x", color="0.9")
    plot.legend(fontsize=8)
    return figure


def convergence(results: Results) -> Figure:
    """Share of the sweeps that have converged, over the travel since contact."""
    figure = Figure(figsize=_SIZE, layout="constrained")
    plot = figure.add_subplot()
    for method in (m for m in _LOOKS if m in results.methods):
        travel = np.sort(results.values(method, "travel_to_convergence_m")) * MM
        travel = travel[np.isfinite(travel)]
        share = np.arange(len(travel) + 1) / max(len(results.sweeps(method)), 1)
        label, colour = _LOOKS[method]
        along = np.concatenate([[min([_EARLIEST, *travel])], travel, [_LATEST]])
        plot.step(along, [*share, share[-1]], where="post", label=label, color=colour)
    plot.axvline(0.0, color="0.6", lw=0.8)
    plot.set_xlim(_EARLIEST, _LATEST)
    plot.set_ylim(0.0, 1.02)
    plot.set_xlabel("travel since contact, mm")
    plot.set_ylabel("share of sweeps converged")
    plot.grid(color="0.9")
    plot.legend(fontsize=8)
    return figure


_EARLIEST, _LATEST = -10.0, 30.0


def error_past_feature(results: Results) -> Figure:
    """Error over the travel since the feature's end, beside what motion alone makes of that at its end."""
    figure = Figure(figsize=_SIZE, layout="constrained")
    plot = figure.add_subplot()
    along = (STRETCHES[:-1] + STRETCHES[1:]) / 2 * MM
    for method, label in (("default", "default"), (SUM, "constant injection (paper's form)")):
        if method not in results.methods:
            continue
        colour = _LOOKS[method][1]
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


def compared_error(results: Results) -> tuple[str, str]:
    """Name of the error to compare by, and in words: that from contact on, or of whole sweeps."""
    known = any(np.isfinite(results.values(m, "error_contact_m")).any() for m in results.methods)
    return (
        ("error_contact_m", "from contact to the feature's end") if known else ("error_m", "over the sweep")
    )


def _draw_curves(
    plot: Axes, results: Results, condition: str, lines: Mapping[str, str], name: str, scale: float
) -> None:
    axis, centres = results.sweep_axis(condition)
    for method, style in lines.items():
        curves = np.array([as_array(sweep[name]) for sweep in results.sweeps(method, condition)])
        drawn, mean = _mean_curve(curves)
        label, colour = _LOOKS[method]
        plot.plot(shown(axis, centres[drawn]), scale * mean, style, color=colour, label=label)
    sweeps = results.sweeps(next(iter(lines)), condition)
    contacts = [sweep["contact_m"] for sweep in sweeps if sweep["contact_m"] is not None]
    if contacts:
        first, last = shown(axis, np.mean(contacts, axis=0))
        plot.axvspan(first, last, color="0.93", zorder=0, label="feature felt (mean)")


def _mean_curve(curves: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which stretches enough of the sweeps (n, stretches) are in, and their means there."""
    counts = np.isfinite(curves).sum(axis=0)
    drawn = counts >= max(1.0, _FEWEST * len(curves))
    return drawn, np.nansum(curves[:, drawn], axis=0) / counts[drawn]


def _label(
    plot: Axes, results: Results, condition: str, what: str, *, inches: bool = True, named: bool = True
) -> None:
    label_axis(plot, "x", results.sweep_axis(condition)[0], inches=inches, label=named)
    plot.set_ylim(bottom=0)
    plot.set_ylabel(what)
    plot.grid(color="0.9")
    plot.legend(fontsize=7)
