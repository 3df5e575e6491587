"""Figures of a scan: the paths of the sweeps and the tactile map (paper, Fig. 3 and 4)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tactile_map import TactileMap, make_map
from tactile_localizer.offline.axes import MM, display_units, label_axis, legend_below, literal
from tactile_localizer.scene import Phalanx, Region, Scene

_COLOURS = "RdBu_r"
_NO_DATA = "0.82"

MAX_CHANNELS = 48
"""Channels of a phalanx shown at most."""


@dataclass(frozen=True)
class DrawnScan:
    """A scan to draw.

    Parameters
    ----------
    scan : the pairs
    scene : its bounds and phalanges; its feature's region is outlined
    unit : of the strain
    """

    scan: Scan
    scene: Scene
    unit: str = "V"

    @cached_property
    def map(self) -> TactileMap:
        """The tactile map, over one or two axes of the scene."""
        return make_map(self.scan, self.scene)

    def title(self, text: str) -> str:
        """Title of a figure: the scene's name, and ``text``."""
        return literal(f"{self.scene.name}: {text}")


def scan_figures(drawn: DrawnScan) -> dict[str, Figure]:
    """Every figure of a scan, by the name of its file."""
    is_plane = len(drawn.map.axes) == 2
    figures = {"map": map_pair(drawn)} if is_plane else {}
    for phalanx in drawn.scan.phalanges:
        figures[f"map_{phalanx}"] = (map_sheet if is_plane else profile_sheet)(drawn, phalanx)
    return figures


def map_sheet(drawn: DrawnScan, phalanx: str) -> Figure:
    """The channels of a phalanx over the palm's position, in one colour scale.

    Of more than :data:`MAX_CHANNELS`, those that vary most are shown. The paths of the sweeps are faint.
    """
    channels = _shown_channels(drawn.map, phalanx)
    rows = math.ceil(len(channels) / 4)
    figure = Figure(figsize=(13, 3.5 * rows), layout="constrained")
    plots = figure.subplots(rows, 4, sharex=True, sharey=True, squeeze=False)
    for plot in plots.flat[len(channels) :]:
        plot.set_axis_off()
    for place, (channel, plot) in enumerate(zip(channels, plots.flat, strict=False)):
        row, column = divmod(place, 4)
        colours = _draw_channel(plot, drawn, phalanx, channel)
        for number in drawn.scan.sweep_numbers:
            plot.plot(*_path(drawn.scan, number), color="0.35", linewidth=0.3, alpha=0.35)
        plot.set_title(f"channel {channel + 1}", fontsize=10)
        label_axis(plot, "x", drawn.map.axes[0], inches=row == 0, label=row == rows - 1)
        label_axis(plot, "y", drawn.map.axes[1], inches=column == 3, label=column == 0)
    _finish(figure, colours, plots.flat[0], plots, drawn)
    figure.suptitle(drawn.title(f"strain of phalanx {phalanx} by the palm's position"))
    return figure


def map_pair(drawn: DrawnScan) -> Figure:
    """The paths of the sweeps and two channels that respond differently (paper, Fig. 3 b, c, d).

    The first channel is the one that varies most, the second the one with the largest part that is not
    proportional to the first.
    """
    figure = Figure(figsize=(14, 5.2), layout="constrained")
    plots = figure.subplots(1, 3)
    _draw_sweeps(plots[0], drawn.scan)
    _draw_bounds(plots[0], drawn.scene)
    plots[0].set_title(f"{len(drawn.scan.sweep_numbers)} sweeps, {len(drawn.scan)} pairs", fontsize=10)
    for plot, (phalanx, channel) in zip(plots[1:], _distinct_channels(drawn.map), strict=True):
        colours = _draw_channel(plot, drawn, phalanx, channel)
        plot.set_title(f"{literal(phalanx)}, channel {channel + 1}", fontsize=10)
    for column, plot in enumerate(plots):
        label_axis(plot, "x", drawn.map.axes[0])
        label_axis(plot, "y", drawn.map.axes[1], inches=column == 2, label=column == 0)
    _finish(figure, colours, plots[1], plots, drawn)
    figure.suptitle(drawn.title("scan and tactile map, by the palm's position"))
    return figure


def profile_sheet(drawn: DrawnScan, phalanx: str) -> Figure:
    """The channels of a phalanx along the only axis of the scene: every sweep, and the map in black."""
    scan, scene, tactile_map = drawn.scan, drawn.scene, drawn.map
    channels = _shown_channels(tactile_map, phalanx)
    figure = Figure(figsize=(13, 1 + 1.25 * len(channels)), layout="constrained")
    plots = figure.subplots(len(channels), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    axis = tactile_map.axes[0]
    start = scan.layout.slices[scan.phalanges.index(phalanx)].start
    profile = tactile_map.phalanx(phalanx)
    for channel, plot in zip(channels, plots, strict=True):
        column = start + channel
        for number in scan.sweep_numbers:
            mine = scan.sweep == number
            along = np.argsort(scan.states[mine, 0])
            values = scan.strain[mine, column] - tactile_map.background[column]
            label = f"sweep {number}" if len(scan.sweep_numbers) <= 6 else None
            positions = display_units(axis, scan.states[mine, 0][along])
            plot.plot(positions, values[along], linewidth=0.7, label=label)
        nodes = display_units(axis, tactile_map.nodes[0])
        plot.plot(nodes, profile[:, channel], "k", linewidth=1.2, label="map")
        plot.set_ylabel(f"{channel + 1}", rotation=0, labelpad=10)
        plot.margins(x=0)
        if scene.feature is not None:
            lower, upper = _palm_limits(scene.feature, _phalanx(scene, phalanx), scene)
            plot.axvspan(*display_units(axis, np.array([lower[0], upper[0]])), color="black", alpha=0.08)
    label_axis(plots[0], "x", axis, label=False)
    label_axis(plots[-1], "x", axis, inches=False)
    legend_below(figure, plots[0])
    figure.supylabel(f"channel: strain minus its median, {literal(drawn.unit)}", fontsize=10)
    figure.suptitle(drawn.title(f"strain of phalanx {phalanx} by the palm's position"))
    return figure


def _draw_channel(plot: Axes, drawn: DrawnScan, phalanx: str, channel: int) -> QuadMesh:
    """Draw the map of one channel and the feature's region; all channels have the same colour scale."""
    tactile_map = drawn.map
    x, y = (
        display_units(axis, nodes) for axis, nodes in zip(tactile_map.axes, tactile_map.nodes, strict=True)
    )
    signal = np.abs(tactile_map.values - tactile_map.background)
    limit = float(np.nanpercentile(signal, 99.8)) or 1.0
    values = tactile_map.phalanx(phalanx)[..., channel].T
    plot.set_facecolor(_NO_DATA)
    if "yaw" not in tactile_map.axes:
        plot.set_aspect("equal")
    mesh = plot.pcolormesh(x, y, np.ma.masked_invalid(values), cmap=_COLOURS, vmin=-limit, vmax=limit)
    _outline(plot, drawn.scene, phalanx)
    return mesh


def _distinct_channels(tactile_map: TactileMap) -> list[tuple[str, int]]:
    """The channel that varies most and the one with the largest residual beside it, with their phalanges."""
    values = tactile_map.values[tactile_map.covered] - tactile_map.background
    values = values - values.mean(axis=0)
    first = int(np.argmax(values.std(axis=0)))
    same = values[:, first] @ values / max(float(values[:, first] @ values[:, first]), 1e-300)
    second = int(np.argmax((values - np.outer(values[:, first], same)).std(axis=0)))
    scene = tactile_map.scene
    places = [scene.layout.place(column) for column in (first, second)]
    return [(scene.phalanx_names[phalanx], channel - 1) for phalanx, channel in places]


def _shown_channels(tactile_map: TactileMap, phalanx: str) -> list[int]:
    """Channels of a phalanx, from 0: all, or the :data:`MAX_CHANNELS` that vary most."""
    spread = np.nan_to_num(tactile_map.phalanx(phalanx)[tactile_map.covered]).std(axis=0)
    return sorted(np.argsort(-spread, kind="stable")[:MAX_CHANNELS].tolist())


def _draw_sweeps(plot: Axes, scan: Scan) -> None:
    """Draw paths coloured by order, with a dot where each begins."""
    numbers = scan.sweep_numbers
    for colour, number in zip(colormaps["viridis"](np.linspace(0, 0.9, len(numbers))), numbers, strict=True):
        x, y = _path(scan, number)
        plot.plot(x, y, color=colour, linewidth=1.0)
        plot.plot(x[:1], y[:1], "o", color=colour, markersize=4)


def _path(scan: Scan, number: int) -> list[np.ndarray]:
    """First two axes of a sweep, in display units."""
    states = scan.states[scan.sweep == number]
    return [display_units(axis, states[:, column]) for column, axis in enumerate(scan.axes[:2])]


def _draw_bounds(plot: Axes, scene: Scene) -> None:
    x, y = scene.axes[:2]
    plot.set_xlim(*display_units(x.name, np.array([x.lower, x.upper])))
    plot.set_ylim(*display_units(y.name, np.array([y.lower, y.upper])))
    if "yaw" not in (x.name, y.name):
        plot.set_aspect("equal")


def _palm_limits(region: Region, phalanx: Phalanx, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Palm positions between which the phalanx is in the region, clipped to the scene's bounds."""
    offset = np.asarray(phalanx.offset)
    lower = np.clip(np.asarray(region.lower) - offset, scene.lower, scene.upper)
    upper = np.clip(np.asarray(region.upper) - offset, scene.lower, scene.upper)
    return lower, upper


def _outline(plot: Axes, scene: Scene, phalanx: str) -> None:
    """Outline the feature's region, if the scene has one; with a yaw it is no rectangle."""
    if scene.feature is None or "yaw" in scene.axis_names[:2]:
        return
    lower, upper = (MM * limit[:2] for limit in _palm_limits(scene.feature, _phalanx(scene, phalanx), scene))
    width, height = upper - lower
    plot.add_patch(
        Rectangle(tuple(lower), width, height, fill=False, linewidth=1.2, label="feature of the scene")
    )


def _phalanx(scene: Scene, name: str) -> Phalanx:
    return scene.phalanges[scene.phalanx_names.index(name)]


def _finish(
    figure: Figure, colours: QuadMesh, legend: Axes, plots: Sequence[Axes] | np.ndarray, drawn: DrawnScan
) -> None:
    """Add the colour bar, and the legend of one plot."""
    bar = figure.colorbar(colours, ax=plots, shrink=0.8, extend="both")
    bar.set_label(f"strain minus that of featureless material, {literal(drawn.unit)}")
    legend_below(figure, legend)
