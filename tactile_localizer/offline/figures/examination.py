"""Figures of a scan's examination: errors of its held-out sweeps, probability of the truth."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from tactile_localizer.core.calibration.examination import Examination
from tactile_localizer.offline.axes import MM, axis_label, display_units
from tactile_localizer.offline.figures.replay import CONVERGED, SEARCHING, WRONG, add_legend
from tactile_localizer.scene import Scene


def held_out_figure(examination: Examination, scene: Scene, size_in: tuple[float, float]) -> Figure:
    """Error along each axis at the end of the held-out sweeps, coloured by what was claimed.

    Parameters
    ----------
    examination : of the scan, with sweeps on the map
    scene : its axes
    size_in : width and height, inches
    """
    figure = Figure(figsize=size_in, layout="constrained")
    plots = figure.subplots(scene.dimension, 1, sharex=True, squeeze=False)[:, 0]
    outcomes = examination.on_map
    colours = [WRONG if each.wrong else CONVERGED if each.right else SEARCHING for each in outcomes]
    for index, (axis, plot) in enumerate(zip(scene.axis_names, plots, strict=True)):
        errors = display_units(axis, np.array([each.error[index] for each in outcomes]))
        plot.scatter([each.sweep + 1 for each in outcomes], errors, c=colours, s=22)
        plot.set(ylabel=f"error in {axis_label(axis)}", ylim=(0.0, 1.1 * max(float(errors.max()), 1.0)))
        plot.grid(alpha=0.3)
    plots[-1].set_xlabel("sweep of the scan, held out")
    plots[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    add_legend(figure)
    return figure


def score_figure(examination: Examination, size_in: tuple[float, float]) -> Figure:
    """Probability given to the truth, the geometric mean along the sweeps, by information length.

    Of each, with the explanation length that was chosen, or, where that was not tried, with the best.

    Parameters
    ----------
    examination, size_in : as for :func:`held_out_figure`
    """
    figure = Figure(figsize=size_in, layout="constrained")
    plot = figure.subplots()
    chosen = examination.explanation_length
    last = sorted(examination.scores, key=lambda each: (each[1] == chosen, each[2]))
    lengths, _, *scores = np.array(sorted({each[0]: each for each in last}.values()), dtype=float).T
    on_map, off_map = np.exp(scores)
    plot.plot(MM * lengths, on_map, "o-", color="tab:blue", label="true place")
    if examination.off_map:
        plot.plot(MM * lengths, off_map, "s--", color="tab:orange", label="unknown material")
    plot.axhline(np.exp(examination.ignorance), color="0.4", ls=":", label="blind guess")
    plot.axvline(MM * examination.information_length, color="0.7", zorder=0, label="chosen")
    plot.set(xlabel="information length, mm", ylabel="probability", xscale="log", ylim=(0.0, 1.0))
    plot.set_xticks(MM * lengths, [f"{MM * length:g}" for length in lengths])
    plot.minorticks_off()
    figure.legend(loc="outside upper left", ncols=2, frameon=False)
    return figure
