"""Picture of a replay: error and standard deviation along the travel of each sweep."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from tactile_localizer.offline.axes import MM
from tactile_localizer.offline.metrics import position_error, travel_from_contact
from tactile_localizer.offline.replay import ReplayedSweep
from tactile_localizer.scene import Scene


def replay_figure(scene: Scene, sweeps: Sequence[ReplayedSweep]) -> Figure:
    """Error (if the truth is known) and standard deviation of the position; green while converged.

    Parameters
    ----------
    scene : scene of the localizer
    sweeps : estimates, one sweep per sweep
    """
    lengths = [index for index, axis in enumerate(scene.axes) if axis.name != "yaw"]
    figure = Figure(figsize=(8.0, 6.0), layout="constrained")
    plots = figure.subplots(2, 1, sharex=True)
    for sweep in sweeps:
        travel = MM * travel_from_contact(sweep)
        variances = np.diagonal(sweep.covariance, axis1=1, axis2=2)[:, lengths]
        rows = MM * position_error(scene, sweep), MM * np.sqrt(variances.sum(axis=1))
        for plot, values in zip(plots, rows, strict=True):
            plot.plot(travel, values, color="0.7", linewidth=0.8)
            plot.plot(travel, np.where(sweep.converged, values, np.nan), color="tab:green", linewidth=1.2)
    has_contact = any(sweep.contact[0] >= 0 for sweep in sweeps)
    titles = ("error, mm (green: converged)", "standard deviation, mm")
    for plot, title in zip(plots, titles, strict=True):
        plot.set_ylabel(title)
        plot.set_ylim(bottom=0.0)
        plot.grid(alpha=0.3)
    plots[1].set_xlabel(f"travel from {'contact' if has_contact else 'the start'}, mm")
    return figure
