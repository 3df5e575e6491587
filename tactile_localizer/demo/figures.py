"""Figure of live sweeps: error along the sweep (paper, Fig. 5) and uncertainty (Fig. 8 b)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tactile_localizer.demo.live_sweep import LIMIT_M, LiveSweep
from tactile_localizer.offline.axes import MM, label_axis

_BIN_MM = 1.0
_HIGHEST_MM = 15.0
"""Upper end of the error axis; larger errors occur only before contact."""
_COLOUR = "tab:blue"
_FEATURE = "tab:orange"


def error_along_the_sweep(sweeps: Sequence[LiveSweep], title: str) -> Figure:
    """Error, standard deviation and fraction of converged sweeps over the true position along x."""
    figure = Figure(figsize=(9, 8.5), layout="constrained")
    error, trace, converged = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 1))
    x = np.concatenate([sweep.truth[:, 0] for sweep in sweeps]) * MM
    for number, sweep in enumerate(sweeps):
        along = sweep.truth[:, 0] * MM
        label = None if number else "each sweep"
        error.plot(along, sweep.error * MM, color="0.6", linewidth=0.5, label=label)
        trace.plot(along, np.sqrt(sweep.trace) * MM, color="0.6", linewidth=0.5)
    _mean_line(error, x, np.concatenate([s.error for s in sweeps]) * MM, f"mean of {len(sweeps)} sweeps")
    _mean_line(trace, x, np.sqrt(np.concatenate([s.trace for s in sweeps])) * MM, "mean")
    _mean_line(converged, x, np.concatenate([s.converged for s in sweeps]).astype(float), "converged")
    error.axhline(LIMIT_M * MM, color="tab:red", linewidth=1.0, linestyle="--", label="0.1 inch")
    error.set_ylabel("error, mm")
    error.set_ylim(0, min(_HIGHEST_MM, error.get_ylim()[1]))
    trace.set_ylabel("standard\ndeviation, mm")
    trace.set_ylim(0, None)
    converged.set_ylabel("fraction of\nsweeps converged")
    converged.set_ylim(-0.05, 1.05)
    for plot in (error, trace, converged):
        _contact_band(plot, sweeps)
        plot.margins(x=0)
    label_axis(error, "x", "x", label=False)
    converged.set_xlabel("true position of the palm along the sweep, mm")
    error.legend(loc="upper right", frameon=False)
    error.set_title(title)
    return figure


def _contact_band(plot: Axes, sweeps: Sequence[LiveSweep]) -> None:
    """Shade the feature, from the median contact of the sweeps to their median end."""
    contacts = np.array([(s.contact.first, s.contact.last) for s in sweeps if s.contact is not None])
    if len(contacts):
        first, last = np.median(contacts, axis=0) * MM
        plot.axvspan(first, last, color=_FEATURE, alpha=0.12, linewidth=0, label="on the feature")


def _mean_line(plot: Axes, x: np.ndarray, values: np.ndarray, label: str) -> None:
    """Mean of the values in bins along x."""
    edges = np.arange(np.floor(x.min()), x.max() + _BIN_MM, _BIN_MM)
    bins = np.digitize(x, edges)
    places = np.unique(bins)
    means = [values[bins == place].mean() for place in places]
    plot.plot(edges[places - 1] + _BIN_MM / 2, means, color=_COLOUR, linewidth=2.0, label=label)
