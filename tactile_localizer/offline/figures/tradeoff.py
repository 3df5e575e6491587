"""Picture of a trade-off: error over computing time, and along the sweeps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from tactile_localizer.core.configuration import SWEEP_MIXTURE
from tactile_localizer.io.configuration_file import PRESETS
from tactile_localizer.offline.axes import MM
from tactile_localizer.offline.tradeoff import DEFAULT, Trade, bin_centres, pareto_front
from tactile_localizer.scene import Scene

MAX_CURVES = 6
"""Most candidates that are drawn along the sweeps; more curves cannot be distinguished."""

_COARSE_TICKS = (1.0, 2.0, 5.0)
_FINE_TICKS = tuple(number / 5 for number in range(5, 50))
"""Ticks per decade of the axes of time and of error."""


def tradeoff_figure(trades: Sequence[Trade], scene: Scene, axis: int) -> Figure:
    """Error over the time per millimetre, and error and covariance along the sweeps (paper, Fig. 5 and 8).

    Parameters
    ----------
    trades : measured candidates
    scene, axis : scene of the recordings and the axis of their sweeps
    """
    figure = Figure(figsize=(11.0, 5.4), layout="constrained")
    panels = figure.subplot_mosaic([["time", "error"], ["time", "trace"]], width_ratios=[1.25, 1.0])
    _draw_times(panels["time"], trades)
    if len(trades) > MAX_CURVES:
        trades = [one for one in trades if one.candidate.name == DEFAULT or _model(one) != SWEEP_MIXTURE]
    _draw_along(panels["error"], trades[:MAX_CURVES], scene, axis, "error_along", MM)
    _draw_along(panels["trace"], trades[:MAX_CURVES], scene, axis, "trace_along", MM**2)
    panels["error"].set_ylabel("mean error, mm")
    panels["error"].legend(fontsize=8)
    panels["error"].tick_params(labelbottom=False)
    panels["trace"].set_ylabel("covariance trace, mm²")
    panels["trace"].set_xlabel(f"{scene.axis_names[axis]}, mm")
    return figure


def _model(one: Trade) -> str:
    return one.candidate.configuration.model


def _draw_times(plot: Axes, trades: Sequence[Trade]) -> None:
    """Draw a point per candidate, coloured by model and filter, with the Pareto front and some names."""
    groups: dict[str, list[Trade]] = {}
    for one in trades:
        label = one.candidate.configuration.filter if _model(one) == SWEEP_MIXTURE else _model(one)
        groups.setdefault(label, []).append(one)
    for label, group in groups.items():
        plot.scatter([one.us_per_mm for one in group], [one.error * MM for one in group], s=18, label=label)
    front = pareto_front(trades)
    times, errors = [one.us_per_mm for one in front], [one.error * MM for one in front]
    plot.step(times, errors, where="post", color="0.4", lw=1, label="Pareto front", zorder=0)
    few = len(trades) <= MAX_CURVES
    named = [one for one in trades if few or one.candidate.name in (DEFAULT, *PRESETS)]
    for one in named:
        place = one.us_per_mm, one.error * MM
        plot.plot(*place, "o", ms=10, mfc="none", mec="black")
        plot.annotate(one.candidate.name, place, xytext=(7, 7), textcoords="offset points", fontsize=9)
    plot.set_xscale("log")
    plot.set_yscale("log")
    for axis, ticks in ((plot.xaxis, _COARSE_TICKS), (plot.yaxis, _FINE_TICKS)):
        axis.set_major_locator(LogLocator(subs=ticks))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter("")
    plot.set_xlabel("processor time per millimetre of travel, µs")
    plot.set_ylabel("mean error, mm")
    plot.set_axisbelow(True)
    plot.grid(color="0.92")
    plot.legend(fontsize=8)


def _draw_along(
    plot: Axes, trades: Sequence[Trade], scene: Scene, axis: int, name: str, scale: float
) -> None:
    """Draw a mean along the sweep axis, a line per candidate."""
    place = bin_centres(scene, axis) * MM
    for one in trades:
        curves = np.array([getattr(outcome, name) for outcome in one.outcomes])
        known = np.isfinite(curves).any(axis=0)
        plot.plot(place[known], scale * np.nanmean(curves[:, known], axis=0), label=one.candidate.name)
    plot.set_ylim(bottom=0)
    plot.grid(color="0.92")
