"""Picture of a trade-off: error over computing time, and along the sweeps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

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
"""Most candidates that are drawn one by one; more are grouped by model and filter."""

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
    few = len(trades) <= MAX_CURVES
    groups: dict[str, list[Trade]] = {}
    for one in trades:
        groups.setdefault(one.candidate.name if few else _kind(one), []).append(one)
    _draw_times(panels["time"], groups, pareto_front(trades))
    for name, scale in (("error", MM), ("trace", MM**2)):
        _draw_along(panels[name], groups, scene, axis, f"{name}_along", scale)
    panels["error"].set_ylabel("mean error, mm")
    panels["error"].tick_params(labelbottom=False)
    panels["trace"].set_ylabel("covariance trace, mm²")
    panels["trace"].set_xlabel(f"{scene.axis_names[axis]}, mm")
    return figure


def _kind(one: Trade) -> str:
    """Model of a candidate, or filter of the default model."""
    configuration = one.candidate.configuration
    return configuration.filter if configuration.model == SWEEP_MIXTURE else configuration.model


def _draw_times(plot: Axes, groups: Mapping[str, Sequence[Trade]], front: Sequence[Trade]) -> None:
    """Draw a point per candidate, coloured by group, with the Pareto front, default and presets."""
    for label, group in groups.items():
        plot.scatter([one.us_per_mm for one in group], [one.error * MM for one in group], s=18, label=label)
        for one in group:
            if one.candidate.name in (DEFAULT, *PRESETS):
                place = one.us_per_mm, one.error * MM
                plot.plot(*place, "o", ms=10, mfc="none", mec="black")
                plot.annotate(
                    one.candidate.name, place, xytext=(2, -17), textcoords="offset points", fontsize=9
                )
    times, errors = [one.us_per_mm for one in front], [one.error * MM for one in front]
    plot.step(times, errors, where="post", color="0.4", lw=1, label="Pareto front", zorder=0)
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
    plot: Axes, groups: Mapping[str, Sequence[Trade]], scene: Scene, axis: int, name: str, scale: float
) -> None:
    """Draw a mean along the sweep axis, a line for the first candidate of each group, in its colour."""
    place = bin_centres(scene, axis) * MM
    for number, (one, *_) in enumerate(groups.values()):
        curves = np.array([getattr(outcome, name) for outcome in one.outcomes])
        known = np.isfinite(curves).any(axis=0)
        mean = scale * np.nanmean(curves[:, known], axis=0)
        plot.plot(place[known], mean, color=f"C{number}", label=one.candidate.name)
    plot.set_ylim(bottom=0)
    plot.grid(color="0.92")
    plot.legend(fontsize=8)
