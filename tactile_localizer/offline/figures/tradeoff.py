"""Picture of a trade-off: error over computing time, and along the sweeps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from tactile_localizer.core.configuration import SWEEP_MIXTURE
from tactile_localizer.io.configuration_file import PRESETS
from tactile_localizer.offline.axes import MM
from tactile_localizer.offline.tradeoff import DEFAULT, Trade, bin_centres, pareto_front
from tactile_localizer.scene import Scene

MAX_CURVES = 6
"""Most candidates that are drawn one by one; more are grouped by model and filter."""

_RINGS = dict(zip((DEFAULT, *PRESETS), "osDv", strict=False))
"""Marker around the default and each preset."""


def tradeoff_figure(trades: Sequence[Trade], scene: Scene, axis: int) -> Figure:
    """Error over the time per millimetre, and error and covariance along the sweeps (paper, Fig. 5 and 8).

    A bar is the 95 % confidence interval of a candidate's difference to the first one. Along the sweeps, the
    first candidate of each group is drawn.

    Parameters
    ----------
    trades : measured candidates
    scene, axis : scene of the recordings and the axis of their sweeps
    """
    figure = Figure(figsize=(11.0, 5.4), layout="constrained")
    panels = figure.subplot_mosaic([["time", "error"], ["time", "trace"]], width_ratios=[1.25, 1.0])
    times, reference = panels["time"], trades[0]
    place = bin_centres(scene, axis) * MM
    groups: dict[str, list[Trade]] = {}
    for one in trades:
        groups.setdefault(one.candidate.name if len(trades) <= MAX_CURVES else _kind(one), []).append(one)
    for number, (label, group) in enumerate(groups.items()):
        points = np.array(
            [(one.us_per_mm, one.error * MM, one.difference(reference)[1] * MM) for one in group]
        )
        colour = f"C{number}"
        x, y, half_widths = points.T
        times.errorbar(x, y, half_widths, fmt="o", ms=4, color=colour, elinewidth=0.7, label=label)
        along = {"error": group[0].error_along * MM, "trace": group[0].trace_along * MM**2}
        for name, values in along.items():
            panels[name].plot(place, values, color=colour, label=group[0].candidate.name)
    for one in trades:
        if (name := one.candidate.name) in _RINGS:
            times.plot(
                one.us_per_mm, one.error * MM, _RINGS[name], ms=11, mfc="none", mec="black", label=name
            )
    front = np.array(sorted((one.us_per_mm, one.error * MM) for one in pareto_front(trades)))
    best = np.minimum.accumulate(front[:, 1])
    times.step(front[:, 0], best, where="post", color="0.4", lw=1, label="Pareto front", zorder=0)
    times.set_xscale("log")
    times.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    times.xaxis.set_major_formatter("{x:g}")
    times.xaxis.set_minor_formatter("")
    times.set_xlabel("processor time per millimetre of travel, µs")
    times.set_ylabel(f"mean error, mm (bars: 95 % interval of the difference to {reference.candidate.name})")
    panels["error"].set_ylabel("mean error, mm")
    panels["error"].tick_params(labelbottom=False)
    panels["trace"].set_ylabel("covariance trace, mm²")
    panels["trace"].set_xlabel(f"{scene.axis_names[axis]}, mm")
    for plot in panels.values():
        plot.set_ylim(bottom=0)
        plot.set_axisbelow(True)
        plot.grid(color="0.92")
        plot.legend(fontsize=8)
    return figure


def _kind(one: Trade) -> str:
    """Model of a candidate, or filter of the default model."""
    configuration = one.candidate.configuration
    return configuration.filter if configuration.model == SWEEP_MIXTURE else configuration.model
