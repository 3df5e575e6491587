"""Figures of a replay: error and standard deviation along the travel, and where the sweeps converge."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from tactile_localizer.offline.axes import MM, axis_label, display_units
from tactile_localizer.offline.figures.proportions import keep_proportions, plan_size
from tactile_localizer.offline.metrics import position_error, travel_from_contact
from tactile_localizer.offline.replay import ReplayedSweep
from tactile_localizer.offline.verdict import relative_error

SEARCHING, CONVERGED, WRONG = "0.7", "tab:green", "tab:red"
"""Colours of estimates by what they claim."""


def replay_figure(sweeps: Sequence[ReplayedSweep], size_in: tuple[float, float] = (8.0, 6.0)) -> Figure:
    """Error (if the truth is known) and standard deviation of the position, coloured while converged.

    Parameters
    ----------
    sweeps : estimates, one sweep per sweep
    size_in : width and height, inches
    """
    has_truth = any(sweep.truth is not None for sweep in sweeps)
    titles = [*(("error, mm",) if has_truth else ()), "standard deviation, mm"]
    figure = Figure(figsize=size_in, layout="constrained")
    plots = figure.subplots(len(titles), 1, sharex=True, squeeze=False)[:, 0]
    for sweep in sweeps:
        lengths = [name != "yaw" for name in sweep.scene.axis_names]
        variances = np.diagonal(sweep.covariance, axis1=1, axis2=2)[:, lengths]
        rows = MM * position_error(sweep), MM * np.sqrt(variances.sum(axis=1))
        for plot, values in zip(plots, rows[-len(plots) :], strict=True):
            plot.plot(MM * travel_from_contact(sweep), values, color=SEARCHING, linewidth=0.8)
            draw_claims(plot, sweep, MM * travel_from_contact(sweep), values, 1.2)
    for plot, title in zip(plots, titles, strict=True):
        plot.set_ylabel(title)
        plot.set_ylim(bottom=0.0)
        plot.grid(alpha=0.3)
    plots[-1].set_xlabel(travel_label(sweeps))
    add_legend(figure)
    return figure


def paths_figure(sweeps: Sequence[ReplayedSweep], width_in: float) -> Figure:
    """Where the palm was along each sweep, by what the estimate claimed there; a dot where a sweep begins.

    Where the truth is unknown, the converged estimates are shown. On one axis sweeps lie side by side.

    Parameters
    ----------
    sweeps : at least one sweep
    width_in : width, inches
    """
    figure = Figure(figsize=plan_size(sweeps[0].scene, width_in)[1], layout="constrained")
    draw_paths(figure.subplots(), sweeps)
    add_legend(figure)
    return figure


def draw_paths(plot: Axes, sweeps: Sequence[ReplayedSweep]) -> None:
    """Draw what :func:`paths_figure` shows, without its legend."""
    scene = sweeps[0].scene
    for sweep in sweeps:
        places = sweep.mean if sweep.truth is None else sweep.truth
        x = display_units(scene.axis_names[0], places[:, 0])
        y = np.full(len(sweep), float(sweep.number))
        if scene.dimension > 1:
            y = display_units(scene.axis_names[1], places[:, 1])
        if sweep.truth is not None:
            plot.plot(x, y, color=SEARCHING, lw=1.0, zorder=1)
            plot.plot(x[:1], y[:1], "o", color=SEARCHING, ms=3, zorder=1)
        draw_claims(plot, sweep, x, y, 2.0)
    plot.set_xlabel(axis_label(scene.axis_names[0]))
    if scene.dimension == 1:
        plot.set_ylabel("sweep")
        plot.yaxis.set_major_locator(MaxNLocator(integer=True))
        return
    plot.set_ylabel(axis_label(scene.axis_names[1]))
    corners = [display_units(axis.name, np.array([axis.lower, axis.upper])) for axis in scene.axes[:2]]
    (left, right), (low, high) = corners
    plot.add_patch(Rectangle((left, low), right - left, high - low, fill=False, ec="0.8", zorder=0))
    keep_proportions(plot, scene.axis_names)


def draw_claims(plot: Axes, sweep: ReplayedSweep, x: np.ndarray, y: np.ndarray, width_pt: float) -> None:
    """Draw the parts of a line (n,) along a sweep where it has converged, and where that is wrong."""
    for claim, colour in ((sweep.converged, CONVERGED), (relative_error(sweep) > 1.0, WRONG)):
        plot.plot(x, np.where(claim, y, np.nan), color=colour, lw=width_pt)


def add_legend(figure: Figure) -> None:
    """What the colours of estimates mean, above the plots."""
    claims = {"not converged": SEARCHING, "converged": CONVERGED, "converged, wrong": WRONG}
    handles = [Line2D([], [], color=colour, lw=2.0, label=name) for name, colour in claims.items()]
    figure.legend(handles=handles, loc="outside upper left", ncols=3, frameon=False)


def travel_label(sweeps: Sequence[ReplayedSweep]) -> str:
    """Label of an axis of :func:`.travel_from_contact`."""
    has_contact = any(sweep.contact[0] >= 0 for sweep in sweeps)
    return f"travel from {'contact' if has_contact else 'the start'}, mm"
