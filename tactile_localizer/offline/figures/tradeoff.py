"""Picture of a trade-off: error over computing time."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from tactile_localizer.core.configuration import SWEEP_MIXTURE
from tactile_localizer.io.configuration_file import PRESETS
from tactile_localizer.offline.axes import MM
from tactile_localizer.offline.tradeoff import DEFAULT, Trade, pareto_front

MAX_NAMED = 6
"""Most candidates that have an entry of their own in the legend; more are grouped by model and filter."""

_RINGS = dict(zip((DEFAULT, *PRESETS), "osDv", strict=False))
"""Marker around the default and each preset."""


def tradeoff_figure(trades: Sequence[Trade]) -> Figure:
    """Mean error over the processor time per millimetre of travel.

    A bar is the 95 % confidence interval of a candidate's difference to the first one; a cross marks a
    candidate with sweeps that were ever wrong.
    """
    figure = Figure(figsize=(8.0, 5.8), layout="constrained")
    plot, reference = figure.subplots(), trades[0]
    groups: dict[str, list[Trade]] = {}
    for one in trades:
        groups.setdefault(one.candidate.name if len(trades) <= MAX_NAMED else _kind(one), []).append(one)
    for label, group in groups.items():
        x, y = _places(group)
        half_widths = [one.difference(reference)[1] * MM for one in group]
        plot.errorbar(x, y, half_widths, fmt="o", ms=4, elinewidth=0.7, label=label)
    plot.plot(*_places([one for one in trades if one.verdict.wrong]), "kx", ms=9, label="sweeps ever wrong")
    for one in trades:
        if (name := one.candidate.name) in _RINGS and name not in groups:
            plot.plot(*_places([one]), _RINGS[name], ms=11, mfc="none", mec="black", label=name)
    x, y = _places(sorted(pareto_front(trades), key=lambda one: one.us_per_mm))
    best = np.minimum.accumulate(y)
    plot.step(x, best, where="post", color="0.4", lw=1, label="Pareto front", zorder=0)
    plot.set_xscale("log")
    plot.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    plot.xaxis.set_major_formatter("{x:g}")
    plot.xaxis.set_minor_formatter("")
    plot.set_xlabel("processor time per millimetre of travel, µs")
    plot.set_ylabel(f"mean error, mm\n(bars: 95 % interval of the difference to {reference.candidate.name})")
    plot.set_ylim(bottom=0)
    plot.grid(color="0.92")
    figure.legend(loc="outside lower center", ncols=4, fontsize=8)
    return figure


def _places(trades: Sequence[Trade]) -> np.ndarray:
    """Times per millimetre, µs, and errors, mm, (2, n)."""
    return np.array([(one.us_per_mm, one.error * MM) for one in trades]).reshape(-1, 2).T


def _kind(one: Trade) -> str:
    """Model of a candidate, or filter of the default model."""
    configuration = one.candidate.configuration
    return configuration.filter if configuration.model == SWEEP_MIXTURE else configuration.model
