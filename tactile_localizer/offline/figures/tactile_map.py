"""Figures of a scan: the paths of the sweeps and the tactile map (paper, Fig. 3 and 4)."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tactile_map import make_map
from tactile_localizer.offline.axes import axis_label, display_units, literal
from tactile_localizer.offline.figures.proportions import is_flat, keep_proportions, plan_size
from tactile_localizer.scene import Phalanx, Scene

_COLOURS = "RdBu_r"
_STRENGTH = "magma_r"
_NO_DATA = "0.82"
SIZE_IN = 3.2
"""Width and height of a map, inches."""
COLUMNS = 5
"""Most maps beside each other."""

MAX_CHANNELS = 48
"""Channels of a phalanx shown at most."""


class MapFigures:
    """Draws what a scan holds.

    Parameters
    ----------
    scan : the pairs
    scene : its bounds and phalanges; its feature's region is outlined
    unit : of the strain
    """

    def __init__(self, scan: Scan, scene: Scene, unit: str = "V") -> None:
        self._scan, self._unit = scan, literal(unit)
        self._map = make_map(scan, scene)
        self._scene, self._axes = self._map.scene, self._map.axes
        self._nodes = [display_units(*each) for each in zip(self._axes, self._map.nodes, strict=True)]
        self._labels = [axis_label(axis) for axis in self._axes]
        self._side = "bottom" if is_flat(self._scene) else "right"

    def channels(
        self, columns: int = COLUMNS, size_in: float = SIZE_IN, most_channels: int = MAX_CHANNELS
    ) -> dict[str, Figure]:
        """One figure per phalanx; its key, ``map_<phalanx>``, is the file name without extension.

        It has all channels of the phalanx, or those that vary most. On one axis it shows
        every sweep, and the map in black; on two, the paths of the sweeps, and the map in one colour scale.

        Parameters
        ----------
        columns, size_in : most maps beside each other, and the width and height of each, inches
        most_channels : channels of a phalanx shown at most
        """
        figures = {}
        for phalanx in self._scene.phalanges:
            spread = np.nan_to_num(self._map.phalanx(phalanx.name)[self._map.covered]).std(axis=0)
            channels = sorted(np.argsort(-spread, kind="stable")[:most_channels].tolist())
            if len(self._axes) == 1:
                figure = self._profiles(phalanx, channels, columns * size_in)
            else:
                figure = self._maps(phalanx, channels, columns, size_in)
            figure.suptitle(
                literal(f"{self._scene.name}: strain of phalanx {phalanx.name}, by the palm's position")
            )
            figures[f"map_{phalanx.name}"] = figure
        return figures

    def signals(self, width_in: float = 5.0) -> dict[str, Figure]:
        """How far the strain of each phalanx is from that of featureless material: what a scan distinguishes.

        The signal is the root mean square over the channels. There is a figure for each phalanx, or on one
        axis for all.

        Parameters
        ----------
        width_in : width of a figure, inches
        """
        size_in, label = plan_size(self._scene, width_in)[1], f"strain above featureless, {self._unit}"
        names = self._scene.phalanx_names
        signals = [np.sqrt(np.mean(self._map.phalanx(name) ** 2, axis=-1)) for name in names]
        if len(self._axes) == 1:
            figure = Figure(figsize=size_in, layout="constrained")
            plot = figure.subplots()
            for name, signal in zip(names, signals, strict=True):
                plot.plot(self._nodes[0], signal, label=literal(name))
            plot.set(xlabel=self._labels[0], ylabel=label, ylim=(0, None))
            plot.legend(frameon=False)
            return {"signal": figure}
        limit, figures = float(np.nanmax(signals)) or 1.0, {}
        for name, signal in zip(names, signals, strict=True):
            figure = figures[f"signal_{name}"] = Figure(figsize=size_in, layout="constrained")
            plot = figure.subplots()
            mesh = self._mesh(plot, signal, cmap=_STRENGTH, vmin=0, vmax=limit)
            plot.set(title=literal(name), xlabel=self._labels[0], ylabel=self._labels[1])
            keep_proportions(plot, self._axes)
            figure.colorbar(mesh, label=label, location=self._side, shrink=0.8)
        return figures

    def _maps(self, phalanx: Phalanx, channels: Sequence[int], columns: int, size_in: float) -> Figure:
        """The paths of the sweeps, and the maps of channels of a phalanx in one colour scale."""
        count = 1 + len(channels)
        columns, (width_in, height_in) = plan_size(self._scene, size_in * columns, count, columns)
        rows = math.ceil(count / columns)
        bar_in = (0.0, 0.6) if is_flat(self._scene) else (0.6 * size_in, 0.0)
        figure = Figure(figsize=(width_in + bar_in[0], height_in + bar_in[1]), layout="compressed")
        plots = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        signal = np.abs(self._map.values - self._map.background)
        limit = float(np.nanpercentile(signal, 99.8)) or 1.0
        self._draw_sweeps(plots.flat[0])
        for channel, plot in zip(channels, plots.flat[1:], strict=False):
            values = self._map.phalanx(phalanx.name)[..., channel]
            colours = self._mesh(plot, values, cmap=_COLOURS, vmin=-limit, vmax=limit)
            plot.set_title(f"channel {channel + 1}", fontsize="medium")
            if self._scene.feature is not None and "yaw" not in self._axes:  # with a yaw it is no rectangle
                (left, right), (low, high) = self._region(phalanx)
                box = Rectangle((left, low), right - left, high - low, fill=False, linewidth=1.2)
                plot.add_patch(box)
        for place, plot in enumerate(plots.flat):
            if place >= count:
                plot.set_axis_off()
            elif place + columns >= count:
                plot.set_xlabel(self._labels[0])
                plot.tick_params(labelbottom=True)  # also where the row below is shorter
            keep_proportions(plot, self._axes)
        for plot in plots[:, 0]:
            plot.set_ylabel(self._labels[1])
        bar = figure.colorbar(colours, ax=plots, extend="both", location=self._side)
        bar.set_label(f"strain minus that\nof featureless material, {self._unit}")
        return figure

    def _profiles(self, phalanx: Phalanx, channels: Sequence[int], width_in: float) -> Figure:
        """Channels of a phalanx along the only axis of the scene: every sweep, and the map in black."""
        scan, axis = self._scan, self._axes[0]
        figure = Figure(figsize=(width_in, 1 + 1.25 * len(channels)), layout="constrained")
        plots = figure.subplots(len(channels), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
        start = scan.layout.slices[scan.phalanges.index(phalanx.name)].start
        for channel, plot in zip(channels, plots, strict=True):
            column = start + channel
            for number in scan.sweep_numbers:
                mine = np.flatnonzero(scan.sweep == number)
                mine = mine[np.argsort(scan.states[mine, 0])]
                values = scan.strain[mine, column] - self._map.background[column]
                label = f"sweep {number}" if len(scan.sweep_numbers) <= 6 else None
                plot.plot(display_units(axis, scan.states[mine, 0]), values, linewidth=0.7, label=label)
            signal = self._map.phalanx(phalanx.name)[:, channel]
            plot.plot(self._nodes[0], signal, "k", linewidth=1.2, label="map")
            plot.set_ylabel(f"{channel + 1}", rotation=0, labelpad=10)
            plot.margins(x=0)
            if self._scene.feature is not None:
                plot.axvspan(*self._region(phalanx)[0], color="black", alpha=0.08)
        plots[-1].set_xlabel(self._labels[0])
        plots[0].legend(loc="upper right", fontsize=8, ncols=4)
        figure.supylabel(f"channel: strain minus its median, {self._unit}", fontsize=10)
        return figure

    def _mesh(self, plot: Axes, values: np.ndarray, **colours: Any) -> QuadMesh:
        """Draw values (n1, n2) of the map's nodes, grey where there are none."""
        plot.set_facecolor(_NO_DATA)
        return plot.pcolormesh(*self._nodes, np.ma.masked_invalid(values.T), rasterized=True, **colours)

    def _draw_sweeps(self, plot: Axes) -> None:
        """Draw paths over the bounds, coloured by order, with a dot where each begins."""
        scan, numbers = self._scan, self._scan.sweep_numbers
        shades = colormaps["viridis"](np.linspace(0, 0.9, len(numbers)))
        for colour, number in zip(shades, numbers, strict=True):
            states = scan.states[scan.sweep == number]
            x, y = (display_units(axis, states[:, column]) for column, axis in enumerate(scan.axes[:2]))
            plot.plot(x, y, color=colour, linewidth=1.0)
            plot.plot(x[:1], y[:1], "o", color=colour, markersize=4)
        plot.set_title(f"{len(numbers)} sweeps, {len(scan)} pairs", fontsize="medium")

    def _region(self, phalanx: Phalanx) -> list[np.ndarray]:
        """On each axis the least and largest palm position with the phalanx in the region, in the bounds."""
        assert self._scene.feature is not None
        limits = np.array([self._scene.feature.lower, self._scene.feature.upper]) - phalanx.offset
        limits = np.clip(limits, self._scene.lower, self._scene.upper)
        return [display_units(*each) for each in zip(self._axes, limits.T, strict=False)]
