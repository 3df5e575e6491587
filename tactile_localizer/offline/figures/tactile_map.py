"""Figures of a scan: the paths of the sweeps and the tactile map (paper, Fig. 3 and 4)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tactile_map import TactileMap, make_map
from tactile_localizer.offline.axes import MM, axis_label, display_units, literal
from tactile_localizer.scene import Phalanx, Region, Scene

_COLOURS = "RdBu_r"
_STRENGTH = "magma_r"
_NO_DATA = "0.82"
SIZE_IN = 3.2
"""Width and height of a map, inches."""
COLUMNS = 5
"""Most maps beside each other."""

MAX_CHANNELS = 48
"""Channels of a phalanx shown at most."""


def scan_figures(
    scan: Scan,
    scene: Scene,
    unit: str = "V",
    columns: int = COLUMNS,
    size_in: float = SIZE_IN,
    most_channels: int = MAX_CHANNELS,
) -> dict[str, Figure]:
    """A figure ``map_<phalanx>`` for each phalanx of a scan, by the name of its file.

    It has all channels of the phalanx, or those that vary most. On one axis it shows
    every sweep, and the map in black; on two, the paths of the sweeps, and the map in one colour scale.

    Parameters
    ----------
    scan : the pairs
    scene : its bounds and phalanges; its feature's region is outlined
    unit : of the strain
    columns, size_in : most maps beside each other, and the width and height of each, inches
    most_channels : channels of a phalanx shown at most
    """
    tactile_map, figures = make_map(scan, scene), {}
    for name in scan.phalanges:
        channels = _shown_channels(tactile_map, name, most_channels)
        if len(tactile_map.axes) == 1:
            figure = _profiles(scan, tactile_map, unit, name, channels, columns * size_in)
        else:
            figure = _maps(scan, tactile_map, unit, name, channels, columns, size_in)
        figures[f"map_{name}"] = figure
    return figures


def signal_figures(
    scan: Scan, scene: Scene, unit: str = "V", size_in: tuple[float, float] = (5.0, 4.4)
) -> dict[str, Figure]:
    """How far the strain of each phalanx is from that of featureless material: what a scan distinguishes.

    The signal is the root mean square over the channels. There is a figure for each phalanx, or on one axis
    for all.

    Parameters
    ----------
    scan, scene, unit : as for :func:`scan_figures`
    size_in : width and height of a figure, inches
    """
    tactile_map = make_map(scan, scene)
    names, axes = scene.phalanx_names, tactile_map.axes
    signals = [np.sqrt(np.mean(tactile_map.phalanx(name) ** 2, axis=-1)) for name in names]
    figures = {}
    if len(axes) == 1:
        figure = figures["signal"] = Figure(figsize=size_in, layout="constrained")
        plot = figure.subplots()
        for name, signal in zip(names, signals, strict=True):
            plot.plot(display_units(axes[0], tactile_map.nodes[0]), signal, label=literal(name))
        plot.set(xlabel=axis_label(axes[0]), ylabel=literal(f"signal, {unit}"), ylim=(0, None))
        plot.legend(frameon=False)
        return figures
    x, y = map(display_units, axes, tactile_map.nodes)
    limit = float(np.nanmax(signals)) or 1.0
    for name, signal in zip(names, signals, strict=True):
        figure = figures[f"signal_{name}"] = Figure(figsize=size_in, layout="constrained")
        plot = figure.subplots()
        plot.set_facecolor(_NO_DATA)
        shown = np.ma.masked_invalid(signal.T)
        mesh = plot.pcolormesh(x, y, shown, cmap=_STRENGTH, vmin=0, vmax=limit, rasterized=True)
        plot.set(title=literal(name), xlabel=axis_label(axes[0]), ylabel=axis_label(axes[1]))
        plot.set_aspect("auto" if "yaw" in axes else "equal")
        figure.colorbar(mesh, label=literal(f"signal, {unit}"), shrink=0.9)
    return figures


def _maps(
    scan: Scan,
    tactile_map: TactileMap,
    unit: str,
    phalanx: str,
    channels: Sequence[int],
    columns: int,
    size_in: float,
) -> Figure:
    """The paths of the sweeps, and the maps of channels of a phalanx."""
    count = 1 + len(channels)
    columns = min(columns, count)
    rows = math.ceil(count / columns)
    size = 0.6 * size_in + size_in * columns, 0.4 * size_in + size_in * rows
    figure = Figure(figsize=size, layout="compressed")
    plots = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for place, plot in enumerate(plots.flat):
        if place >= count:
            plot.set_axis_off()
            continue
        if place == 0:
            _draw_sweeps(plot, scan)
        else:
            colours = _draw_channel(plot, tactile_map, phalanx, channels[place - 1])
            plot.set_title(f"channel {channels[place - 1] + 1}", fontsize="medium")
        plot.set_aspect("auto" if "yaw" in tactile_map.axes else "equal")
        if place + columns >= count:
            plot.set_xlabel(axis_label(tactile_map.axes[0]))
        if place % columns == 0:
            plot.set_ylabel(axis_label(tactile_map.axes[1]))
    bar = figure.colorbar(colours, ax=plots, extend="both")
    bar.set_label(f"strain minus that\nof featureless material, {literal(unit)}")
    title = f"{tactile_map.scene.name}: strain of phalanx {phalanx}, by the palm's position"
    figure.suptitle(literal(title))
    return figure


def _profiles(
    scan: Scan, tactile_map: TactileMap, unit: str, phalanx: str, channels: Sequence[int], width_in: float
) -> Figure:
    """Channels of a phalanx along the only axis of the scene: every sweep, and the map in black."""
    scene = tactile_map.scene
    figure = Figure(figsize=(width_in, 1 + 1.25 * len(channels)), layout="constrained")
    plots = figure.subplots(len(channels), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    axis = tactile_map.axes[0]
    nodes = display_units(axis, tactile_map.nodes[0])
    start = scan.layout.slices[scan.phalanges.index(phalanx)].start
    for channel, plot in zip(channels, plots, strict=True):
        column = start + channel
        for number in scan.sweep_numbers:
            mine = np.flatnonzero(scan.sweep == number)
            mine = mine[np.argsort(scan.states[mine, 0])]
            values = scan.strain[mine, column] - tactile_map.background[column]
            label = f"sweep {number}" if len(scan.sweep_numbers) <= 6 else None
            plot.plot(display_units(axis, scan.states[mine, 0]), values, linewidth=0.7, label=label)
        plot.plot(nodes, tactile_map.phalanx(phalanx)[:, channel], "k", linewidth=1.2, label="map")
        plot.set_ylabel(f"{channel + 1}", rotation=0, labelpad=10)
        plot.margins(x=0)
        if scene.feature is not None:
            lower, upper = _palm_limits(scene.feature, _phalanx(scene, phalanx), scene)
            plot.axvspan(*display_units(axis, np.array([lower[0], upper[0]])), color="black", alpha=0.08)
    plots[-1].set_xlabel(axis_label(axis))
    plots[0].legend(loc="upper right", fontsize=8, ncols=4)
    figure.supylabel(f"channel: strain minus its median, {literal(unit)}", fontsize=10)
    figure.suptitle(literal(f"{scene.name}: strain of phalanx {phalanx}, by the palm's position"))
    return figure


def _draw_channel(plot: Axes, tactile_map: TactileMap, phalanx: str, channel: int) -> QuadMesh:
    """Draw the map of one channel and the feature's region; all channels have the same colour scale."""
    scene = tactile_map.scene
    x, y = map(display_units, tactile_map.axes, tactile_map.nodes)
    signal = np.abs(tactile_map.values - tactile_map.background)
    limit = float(np.nanpercentile(signal, 99.8)) or 1.0
    values = tactile_map.phalanx(phalanx)[..., channel].T
    plot.set_facecolor(_NO_DATA)
    mesh = plot.pcolormesh(
        x, y, np.ma.masked_invalid(values), cmap=_COLOURS, vmin=-limit, vmax=limit, rasterized=True
    )
    if scene.feature is not None and "yaw" not in tactile_map.axes:  # with a yaw it is no rectangle
        limits = _palm_limits(scene.feature, _phalanx(scene, phalanx), scene)
        lower, upper = (MM * limit[:2] for limit in limits)
        plot.add_patch(Rectangle(tuple(lower), *(upper - lower), fill=False, linewidth=1.2))
    return mesh


def _shown_channels(tactile_map: TactileMap, phalanx: str, most: int) -> list[int]:
    """Channels of a phalanx, from 0: all, or the ``most`` that vary most."""
    spread = np.nan_to_num(tactile_map.phalanx(phalanx)[tactile_map.covered]).std(axis=0)
    return sorted(np.argsort(-spread, kind="stable")[:most].tolist())


def _draw_sweeps(plot: Axes, scan: Scan) -> None:
    """Draw paths over the bounds, coloured by order, with a dot where each begins."""
    numbers = scan.sweep_numbers
    for colour, number in zip(colormaps["viridis"](np.linspace(0, 0.9, len(numbers))), numbers, strict=True):
        states = scan.states[scan.sweep == number]
        x, y = (display_units(axis, states[:, column]) for column, axis in enumerate(scan.axes[:2]))
        plot.plot(x, y, color=colour, linewidth=1.0)
        plot.plot(x[:1], y[:1], "o", color=colour, markersize=4)
    plot.set_title(f"{len(numbers)} sweeps, {len(scan)} pairs", fontsize="medium")


def _palm_limits(region: Region, phalanx: Phalanx, scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Palm positions between which the phalanx is in the region, clipped to the scene's bounds."""
    offset = np.asarray(phalanx.offset)
    lower = np.clip(np.asarray(region.lower) - offset, scene.lower, scene.upper)
    upper = np.clip(np.asarray(region.upper) - offset, scene.lower, scene.upper)
    return lower, upper


def _phalanx(scene: Scene, name: str) -> Phalanx:
    return scene.phalanges[scene.phalanx_names.index(name)]
