"""Figure of the feature's region over the strain, for the user to accept or change (paper, Fig. 7)."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from tactile_localizer.core.calibration.feature_region import Proposal
from tactile_localizer.core.scan.tactile_map import TactileMap
from tactile_localizer.offline.axes import display_units, label_axis, legend_below, literal
from tactile_localizer.scene import Region, Scene

_GIVEN = {"edgecolor": "black", "linestyle": "-", "linewidth": 1.4}
_PROPOSED = {"edgecolor": "tab:red", "linestyle": "--", "linewidth": 1.6}
_TOUCHED = "tab:red"
_DOTS = "differs from featureless material"
_NO_DATA = "lightsteelblue"


def region_sheet(tactile_map: TactileMap, scene: Scene, proposal: Proposal, *, unit: str = "V") -> Figure:
    """Distance of each phalanx's strain from that of featureless material, by its position, with the regions.

    Dots mark the cells in which most strains differ from featureless material. Solid: the region given by
    the scene; dashed: the proposed one.

    Parameters
    ----------
    tactile_map : of the scan
    scene : may give a region
    proposal : of :func:`~tactile_localizer.core.calibration.feature_region.propose_region`
    unit : of the strain
    """
    signal = [np.linalg.norm(tactile_map.phalanx(name), axis=-1) for name in scene.phalanx_names]
    limit = float(np.nanpercentile(np.stack(signal), 99.8)) or 1.0
    draw = _draw_plane if len(tactile_map.axes) == 2 else _draw_line
    figure = draw(tactile_map, scene, proposal, signal, limit, unit)
    for plot in figure.axes[: len(signal)]:
        if scene.feature is not None:
            _box(plot, scene.feature, tactile_map.axes, "given by the scene", _GIVEN)
        if proposal.region is not None:
            _box(plot, proposal.region, tactile_map.axes, "proposed", _PROPOSED)
    legend_below(figure, figure.axes[0])
    found = "no region found" if proposal.region is None else "the feature's region"
    figure.suptitle(f"{literal(scene.name)}: {found}; by the position of each phalanx")
    return figure


def _draw_plane(
    tactile_map: TactileMap,
    scene: Scene,
    proposal: Proposal,
    signal: list[np.ndarray],
    limit: float,
    unit: str,
) -> Figure:
    count = len(signal)
    figure = Figure(figsize=(4.6 * count + 1.5, 5.8), layout="constrained")
    plots = figure.subplots(1, count, sharex=True, sharey=True, squeeze=False)[0]
    for number, plot in enumerate(plots):
        x, y = (places.T for places in _places(tactile_map, scene, number))
        values = np.ma.masked_invalid(signal[number].T)
        colours = plot.pcolormesh(x, y, values, cmap="Greys", vmin=0, vmax=limit)
        plot.plot(*_touched(tactile_map, proposal, number), ".", color=_TOUCHED, markersize=3, label=_DOTS)
        plot.set_facecolor(_NO_DATA)
        plot.set_title(literal(scene.phalanx_names[number]), fontsize=10)
        label_axis(plot, "x", tactile_map.axes[0])
        label_axis(plot, "y", tactile_map.axes[1], label=number == 0, inches=number == count - 1)
        if "yaw" not in tactile_map.axes:
            plot.set_aspect("equal")
    plots[0].plot([], [], "s", color=_NO_DATA, label="not covered by a sweep")
    bar = figure.colorbar(colours, ax=plots, shrink=0.8, extend="max")
    bar.set_label(f"distance of the strain from featureless material, {literal(unit)}")
    plots[0].set(xlim=_span(tactile_map, scene, 0), ylim=_span(tactile_map, scene, 1))
    return figure


def _draw_line(
    tactile_map: TactileMap,
    scene: Scene,
    proposal: Proposal,
    signal: list[np.ndarray],
    limit: float,
    unit: str,
) -> Figure:
    count = len(signal)
    figure = Figure(figsize=(11, 2.6 * count + 1), layout="constrained")
    plots = figure.subplots(count, 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for number, plot in enumerate(plots):
        plot.plot(_places(tactile_map, scene, number)[0], signal[number], color="0.3", linewidth=0.8)
        (cells,) = _touched(tactile_map, proposal, number)
        plot.plot(cells, np.full(len(cells), -0.04 * limit), ".", color=_TOUCHED, markersize=4, label=_DOTS)
        plot.set_title(literal(scene.phalanx_names[number]), fontsize=10)
        plot.set_ylabel(literal(unit))
        label_axis(plot, "x", tactile_map.axes[0], label=number == count - 1, inches=number == 0)
    plots[0].set(xlim=_span(tactile_map, scene, 0), ylim=(-0.1 * limit, limit))
    return figure


def _places(tactile_map: TactileMap, scene: Scene, number: int) -> list[np.ndarray]:
    """By axis, where a phalanx is when the palm is at the map's nodes, as shown: arrays of its shape."""
    places = tactile_map.places(scene, scene.phalanges[number])
    return [display_units(axis, places[..., column]) for column, axis in enumerate(tactile_map.axes)]


def _touched(tactile_map: TactileMap, proposal: Proposal, number: int) -> list[np.ndarray]:
    """Centres of the cells where a phalanx touches the feature, by axis, in display units."""
    places = np.nonzero(proposal.cells[number])
    return [
        display_units(axis, proposal.axes[number][column][places[column]])
        for column, axis in enumerate(tactile_map.axes)
    ]


def _span(tactile_map: TactileMap, scene: Scene, column: int) -> tuple[float, float]:
    """Lowest and highest position of the phalanges on an axis, in display units."""
    ends = np.stack([_places(tactile_map, scene, n)[column] for n in range(len(scene.phalanges))])
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
