"""Figure of the feature's region over the strain, for the user to accept or change (paper, Fig. 7)."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from tactile_localizer.core.calibration.feature_region import Proposal
from tactile_localizer.offline.axes import display_units, label_axis, legend_below, literal
from tactile_localizer.offline.figures.tactile_map import DrawnScan
from tactile_localizer.scene import Region

_GIVEN = {"edgecolor": "black", "linestyle": "-", "linewidth": 1.4}
_PROPOSED = {"edgecolor": "tab:red", "linestyle": "--", "linewidth": 1.6}
_TOUCHED = "tab:red"
_DOTS = "differs from featureless material"
_NO_DATA = "lightsteelblue"


def region_sheet(drawn: DrawnScan, proposal: Proposal) -> Figure:
    """Distance of each phalanx's strain from that of featureless material, by its position, with the regions.

    Dots mark the cells in which most strains differ from featureless material. Solid: the region given by
    the scene; dashed: the one of :func:`~tactile_localizer.core.calibration.feature_region.propose_region`.
    """
    scene, axes, count = drawn.scene, drawn.map.axes, len(drawn.scene.phalanges)
    is_plane = len(axes) == 2
    signal = [np.linalg.norm(drawn.map.phalanx(name), axis=-1) for name in scene.phalanx_names]
    limit = float(np.nanpercentile(np.stack(signal), 99.8)) or 1.0
    size, grid = ((4.6 * count + 1.5, 5.8), (1, count)) if is_plane else ((11, 2.6 * count + 1), (count, 1))
    figure = Figure(figsize=size, layout="constrained")
    plots = figure.subplots(*grid, sharex=True, sharey=True, squeeze=False).ravel()
    for number, plot in enumerate(plots):
        places, touched = _places(drawn, number), _touched(drawn, proposal, number)
        is_first, is_last = number == 0, number == count - 1
        if is_plane:
            values = np.ma.masked_invalid(signal[number])
            colours = plot.pcolormesh(*places, values, cmap="Greys", vmin=0, vmax=limit)
            plot.set_facecolor(_NO_DATA)
            label_axis(plot, "y", axes[1], label=is_first, inches=is_last)
            if "yaw" not in axes:
                plot.set_aspect("equal")
        else:
            plot.plot(places[0], signal[number], color="0.3", linewidth=0.8)
            touched.append(np.full(len(touched[0]), -0.04 * limit))
            plot.set_ylabel(literal(drawn.unit))
        plot.plot(*touched, ".", color=_TOUCHED, markersize=3, label=_DOTS)
        plot.set_title(literal(scene.phalanx_names[number]), fontsize=10)
        label_axis(plot, "x", axes[0], label=is_plane or is_last, inches=is_plane or is_first)
    if is_plane:
        plots[0].plot([], [], "s", color=_NO_DATA, label="not covered by a sweep")
        bar = figure.colorbar(colours, ax=plots, shrink=0.8, extend="max")
        bar.set_label(f"distance of the strain from featureless material, {literal(drawn.unit)}")
    plots[0].set(xlim=_span(drawn, 0), ylim=_span(drawn, 1) if is_plane else (-0.1 * limit, limit))
    for plot in plots:
        if scene.feature is not None:
            _box(plot, scene.feature, axes, "given by the scene", _GIVEN)
        if proposal.region is not None:
            _box(plot, proposal.region, axes, "proposed", _PROPOSED)
    legend_below(figure, plots[0])
    found = "no region found" if proposal.region is None else "the feature's region"
    figure.suptitle(drawn.title(f"{found}; by the position of each phalanx"))
    return figure


def _places(drawn: DrawnScan, number: int) -> list[np.ndarray]:
    """By axis, where a phalanx is when the palm is at the map's nodes, as shown: arrays of its shape."""
    places = drawn.map.places(drawn.scene.phalanges[number])
    return [display_units(axis, places[..., column]) for column, axis in enumerate(drawn.map.axes)]


def _touched(drawn: DrawnScan, proposal: Proposal, number: int) -> list[np.ndarray]:
    """Centres of the cells where a phalanx touches the feature, by axis, in display units."""
    places = np.nonzero(proposal.cells[number])
    return [
        display_units(axis, proposal.axes[number][column][places[column]])
        for column, axis in enumerate(drawn.map.axes)
    ]


def _span(drawn: DrawnScan, column: int) -> tuple[float, float]:
    """Lowest and highest position of the phalanges on an axis, in display units."""
    ends = np.stack([_places(drawn, n)[column] for n in range(len(drawn.scene.phalanges))])
    return float(ends.min()), float(ends.max())


def _box(plot: Axes, region: Region, axes: tuple[str, ...], label: str, style: dict[str, Any]) -> None:
    """Outline a region; sides without a limit are at the plot's edge."""
    limits = [plot.get_xlim(), plot.get_ylim()]
    for column, axis in enumerate(axes):
        lower, upper = np.clip(
            display_units(axis, np.array([region.lower[column], region.upper[column]])), *limits[column]
        )
        limits[column] = (float(lower), float(upper))
    (left, right), (low, high) = limits
    plot.add_patch(Rectangle((left, low), right - left, high - low, fill=False, label=label, **style))
