"""Figures of one sweep: the belief at some moments of it, and its probability and error along the travel."""

from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.path import Path

from tactile_localizer.offline.axes import MM, axis_label, display_units
from tactile_localizer.offline.figures.proportions import keep_proportions, plan_size
from tactile_localizer.offline.figures.replay import CONVERGED, SEARCHING, draw_claims, travel_label
from tactile_localizer.offline.metrics import position_error, travel_from_contact
from tactile_localizer.offline.replay import ReplayedSweep
from tactile_localizer.scene import Scene

_BELIEF = "Blues"
_BINS = 80
"""Bins along an axis of a belief whose states lie on no grid, and the most nodes of one that does."""
_TRUTH = "tab:red"
_CROSS = Path(
    [(0.4, 0.0), (1.0, 0.0), (-0.4, 0.0), (-1.0, 0.0), (0.0, 0.4), (0.0, 1.0), (0.0, -0.4), (0.0, -1.0)],
    [Path.MOVETO, Path.LINETO] * 4,
)
"""A cross that is open in the middle, where the belief is once it has converged."""


def belief_figure(
    sweep: ReplayedSweep,
    moments: Sequence[int],
    beliefs: Sequence[tuple[np.ndarray, np.ndarray]],
    width_in: float,
) -> Figure:
    """The belief at moments A, B, ... of a sweep, with the true position as a cross where it is known.

    Of three axes the first two are shown; on one, the probability along it.

    Parameters
    ----------
    sweep : estimates along the sweep
    moments : indices of estimates
    beliefs : states (P, d) and weights (P,) at each moment
    width_in : width, inches
    """
    scene = sweep.scene
    columns, size_in = plan_size(scene, width_in, len(moments), columns=2)
    figure = Figure(figsize=size_in, layout="constrained")
    plots = figure.subplots(-(-len(moments) // columns), columns, sharex=True, sharey=True, squeeze=False)
    for plot in plots.flat[len(moments) :]:
        plot.set_axis_off()
    draw = _along if scene.dimension == 1 else _plan
    for letter, plot, moment, belief in zip("ABCDEFGH", plots.flat, moments, beliefs, strict=False):
        draw(scene, plot, *belief)
        truth = np.full(scene.dimension, np.nan) if sweep.truth is None else sweep.truth[moment]
        place = [display_units(axis, value) for axis, value in zip(scene.axis_names, truth, strict=True)]
        plot.plot(
            place[0],
            place[1] if scene.dimension > 1 else 0.0,
            marker=_CROSS,
            color=_TRUTH,
            ms=20,
            mew=1.4,
            mfc="none",
            clip_on=False,
        )
        colour = CONVERGED if sweep.converged[moment] else "0.2"
        plot.set_title(f"{letter}: {sweep.state[moment].value}", color=colour)
    for plot in plots[-1]:
        plot.set_xlabel(axis_label(scene.axis_names[0]))
    for plot in plots[:, 0]:
        plot.set_ylabel("probability" if scene.dimension == 1 else axis_label(scene.axis_names[1]))
    return figure


def progress_figure(sweep: ReplayedSweep, moments: Sequence[int], size_in: tuple[float, float]) -> Figure:
    """The probability, and the error where the truth is known, along a sweep with its moments A, B, ...

    Parameters
    ----------
    sweep, moments : as for :func:`belief_figure`
    size_in : width and height, inches
    """
    figure = Figure(figsize=size_in, layout="constrained")
    error, travel = MM * position_error(sweep), MM * travel_from_contact(sweep)
    rows = [("probability", sweep.probability)]
    if np.isfinite(error).any():
        rows.append(("error, mm", error))
    plots = figure.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0]
    for plot, (label, values) in zip(plots, rows, strict=True):
        plot.plot(travel, values, color=SEARCHING, lw=1.0)
        draw_claims(plot, sweep, travel, values, 1.6)
        plot.set(ylabel=label, ylim=(0.0, 1.05 if label == "probability" else None))
        plot.vlines(travel[list(moments)], *plot.get_ylim(), color="0.6", lw=0.7, ls=":")
    plots[0].axhline(sweep.criteria.probability, color="0.4", ls="--", lw=0.8)
    for letter, moment in zip("ABCDEFGH", moments, strict=False):
        plots[0].text(travel[moment], 1.07, letter, ha="center", va="bottom")
    plots[-1].set_xlabel(travel_label([sweep]))
    return figure


def _plan(scene: Scene, plot: Axes, states: np.ndarray, weights: np.ndarray) -> None:
    """The belief over the first two axes, as darkness (the root of the probability)."""
    x, y = (display_units(axis, states[:, column]) for column, axis in enumerate(scene.axis_names[:2]))
    bounds = [display_units(axis.name, np.array([axis.lower, axis.upper])) for axis in scene.axes[:2]]
    mass, *edges = np.histogram2d(x, y, [_edges(x, bounds[0]), _edges(y, bounds[1])], weights=weights)
    plot.set_facecolor(colormaps[_BELIEF](0.0))
    shade = np.sqrt(mass.T / (mass.max() or 1.0))
    plot.pcolormesh(*edges, shade, cmap=_BELIEF, vmin=0.0, vmax=1.0, rasterized=True)
    plot.set(xlim=bounds[0], ylim=bounds[1])
    keep_proportions(plot, scene.axis_names)


def _along(scene: Scene, plot: Axes, states: np.ndarray, weights: np.ndarray) -> None:
    """The belief over the only axis."""
    axis = scene.axes[0]
    bounds = display_units(axis.name, np.array([axis.lower, axis.upper]))
    x = display_units(axis.name, states[:, 0])
    mass, edges = np.histogram(x, _edges(x, bounds), weights=weights)
    plot.stairs(mass, edges, fill=True, color=SEARCHING)
    plot.set_xlim(bounds[0], bounds[1])


def _edges(values: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Edges between the nodes of a grid that values lie on, or of bins of equal width over the bounds."""
    nodes = np.unique(np.round(values, 6))
    steps = np.diff(nodes)
    if len(nodes) < 2 or len(nodes) > _BINS * 4 or np.ptp(steps / steps.min() % 1.0) > 0.01:
        return np.linspace(bounds[0], bounds[1], _BINS + 1)
    step = steps.min()
    return nodes[0] - step / 2 + step * np.arange(round((nodes[-1] - nodes[0]) / step) + 2)
