"""The tactile map (paper, II-B): every strain element interpolated on a regular grid of palm positions."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.geometry.phalanges import phalanx_positions, turned_offsets
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ParameterError
from tactile_localizer.scene import Phalanx, Scene

DEFAULT_NEIGHBOURS = 8
"""Neighbours that a node of the grid is interpolated from; the paper's k."""

DEFAULT_NODES = {1: 1200, 2: 120}
"""Nodes along the longer axis, by the number of axes that are shown."""


_SWEEPS, _PAIRS = 40, 200
"""Most sweeps, and half the most pairs of each, that the sweeps' distance is found from."""


@dataclass(frozen=True)
class TactileMap:
    """Strain on a regular grid over one or two axes of the scene.

    Parameters
    ----------
    axes : names of the axes, one or two
    nodes : by axis, the palm positions of the grid's nodes, m (yaw: rad), ascending
    values : (n1, C) or (n1, n2, C) strain voltages, V; NaN where no pair is near enough
    background : (C,) strain of featureless material: the median over the scan's pairs, V
    phalanges : names of the F phalanges
    channels : channels of each phalanx; empty: the default for each
    """

    axes: tuple[str, ...]
    nodes: tuple[np.ndarray, ...]
    values: np.ndarray
    background: np.ndarray
    phalanges: tuple[str, ...]
    channels: tuple[int, ...] = ()

    @cached_property
    def layout(self) -> ChannelLayout:
        """The channels by phalanx."""
        return ChannelLayout.of(self.channels, len(self.phalanges))

    def phalanx(self, name: str) -> np.ndarray:
        """The channels of a phalanx less their background, (..., channels), V."""
        columns = self.layout.slices[self.phalanges.index(name)]
        return self.values[..., columns] - self.background[columns]

    def places(self, scene: Scene, phalanx: Phalanx) -> np.ndarray:
        """Where a phalanx is when the palm is at the nodes, (n1, 1) or (n1, n2, 2), m (yaw: rad)."""
        nodes = np.stack(np.meshgrid(*self.nodes, indexing="ij"), axis=-1)
        states = np.zeros((*nodes.shape[:-1], scene.dimension))
        states[..., : len(self.axes)] = nodes
        placed = phalanx_positions(scene, phalanx, states.reshape(-1, scene.dimension))
        return placed.reshape(states.shape)[..., : len(self.axes)]

    @property
    def covered(self) -> np.ndarray:
        """Which nodes have data, bool of the grid's shape."""
        return np.asarray(np.isfinite(self.values).all(axis=-1))


def make_map(
    scan: Scan,
    scene: Scene,
    *,
    nodes: int | None = None,
    neighbours: int = DEFAULT_NEIGHBOURS,
    reach: float | None = None,
) -> TactileMap:
    """Interpolate a scan on a regular grid over the scene's bounds.

    A node's value is the mean of its nearest neighbours, with biweight weights that fall to zero at the
    first one that does not count, so that the map changes without steps. Pairs are first averaged by
    cells of half the sweeps' distance, so that the neighbours lie on several sweeps and a slow palm does
    not outweigh a fast one. Of three axes the first two are shown; pairs of all values of the third count.
    Where that is yaw, each phalanx is shown where it was: the nodes are palm positions of a hand at yaw zero.

    Parameters
    ----------
    scan : the pairs; of axes and phalanges that the scene does not name nothing is shown
    scene : its bounds and axes
    nodes : nodes along the longer axis; by default :data:`DEFAULT_NODES`
    neighbours : cells that a node is interpolated from
    reach : distance beyond which a pair does not contribute to a node, m; by default 1.5 times the distance
        of the sweeps, or of the pairs on a sweep where that is greater

    Raises
    ------
    ParameterError
        ``nodes`` or ``neighbours`` is less than 2.
    """
    shown = min(scene.dimension, 2)
    nodes = DEFAULT_NODES[shown] if nodes is None else nodes
    for name, value in (("nodes", nodes), ("neighbours", neighbours)):
        if value < 2:
            raise ParameterError(f"{name}: expected at least 2, got {value}")
    scale = axis_scale(scene)[:shown]
    lower, upper = scene.lower[:shown] * scale, scene.upper[:shown] * scale
    step = float(np.max(upper - lower)) / (nodes - 1)
    counts = [max(2, math.floor(extent / step + 1e-9) + 1) for extent in upper - lower]
    grid = tuple(np.linspace(low, high, count) for low, high, count in zip(lower, upper, counts, strict=True))
    palms = scan.states[:, scene.columns(scan.axes)]
    scan = Scan(
        palms[:, :shown] * scale,
        scan.strain[:, scene.channels(scan.phalanges, scan.channels)],
        scan.sweep,
        scene.axis_names[:shown],
        scene.phalanx_names,
        scene.layout.counts,
    )
    distance = sweep_distance(scan, step)
    cell = max(step, distance / 2)
    if reach is None:
        reach = max(1.5 * distance, 1.5 * _pair_distance(scan), cell)
    queries = np.stack(np.meshgrid(*grid, indexing="ij"), axis=-1).reshape(-1, shown)
    values = np.empty((len(queries), scan.strain.shape[1]))
    for columns, states in _shown_where(scene, palms, shown):
        places, strain = _cell_means(states * scale, scan.strain[:, columns], lower, cell)
        values[:, columns] = _local_mean(places, strain, queries, neighbours, reach)
    return TactileMap(
        axes=scan.axes,
        nodes=tuple(nodes / unit for nodes, unit in zip(grid, scale, strict=True)),
        values=values.reshape(*counts, -1),
        background=np.median(scan.strain, axis=0),
        phalanges=scan.phalanges,
        channels=scan.channels,
    )


def _shown_where(scene: Scene, palms: np.ndarray, shown: int) -> Iterator[tuple[slice, np.ndarray]]:
    """Columns of the strain and where on the first axes their pairs are shown, (N, shown)."""
    if "yaw" not in scene.axis_names[shown:]:
        yield slice(None), palms[:, :shown]
        return
    for phalanx, columns in zip(scene.phalanges, scene.layout.slices, strict=True):
        moved = turned_offsets(scene, phalanx, palms) - np.asarray(phalanx.offset)
        yield columns, (palms + moved)[:, :shown]


def axis_scale(scene: Scene) -> np.ndarray:
    """Metres that a unit of each axis counts for in distances, (d,).

    Beside lengths a yaw counts for as much as makes its extent that of the longest axis.
    """
    extent = scene.upper - scene.lower
    angle = np.array([axis.name == "yaw" for axis in scene.axes])
    if angle.all() or not angle.any():
        return np.ones(len(extent))
    return np.where(angle, extent[~angle].max() / extent, 1.0)


def sweep_distance(scan: Scan, least: float = 0.0) -> float:
    """Typical distance of a pair to the nearest of another sweep in the plane, m; 0 for one sweep.

    Pairs within ``least``, m, of a sweep are on the same line, as those of a way back, and do not count.
    """
    numbers = scan.sweep_numbers
    rows = [np.flatnonzero(scan.sweep == number) for number in numbers]
    rows = [own[:: max(1, len(own) // _PAIRS)] for own in rows]  # enough to know a line by
    distances = [np.empty(0)]
    for index in np.unique(np.linspace(0, len(numbers) - 1, _SWEEPS).astype(int)):
        mine = scan.states[rows[index], :2]
        others = scan.states[np.concatenate([rows[index][:0], *rows[:index], *rows[index + 1 :]]), :2]
        if least and len(others):
            others = others[cKDTree(mine).query(others)[0] > least]
        if len(others):
            distances.append(cKDTree(others).query(mine)[0])
    found = np.concatenate(distances)
    return float(np.median(found)) if len(found) else 0.0


def _pair_distance(scan: Scan) -> float:
    """Typical distance of two consecutive pairs of a sweep; 0 where no sweep has two."""
    steps = np.linalg.norm(np.diff(scan.states, axis=0), axis=1)[np.diff(scan.sweep) == 0]
    return float(np.median(steps)) if len(steps) else 0.0


def _cell_means(
    states: np.ndarray, strain: np.ndarray, lower: np.ndarray, size: float
) -> tuple[np.ndarray, np.ndarray]:
    """Mean state and strain of the pairs in each cell of a grid that has any."""
    cells = np.floor((states - lower) / size).astype(np.int64)
    _, cell, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(cell.ravel(), kind="stable")
    starts = np.concatenate([[0], np.cumsum(count)[:-1]])
    means = [np.add.reduceat(values[order], starts) / count[:, None] for values in (states, strain)]
    return means[0], means[1]


def _local_mean(
    places: np.ndarray, strain: np.ndarray, queries: np.ndarray, neighbours: int, reach: float
) -> np.ndarray:
    """Weighted mean strain (Q, C) of the nearest places to each query; NaN beyond reach."""
    k = min(neighbours + 1, len(places))
    distance, index = cKDTree(places).query(queries, k=list(range(1, k + 1)))
    width = np.minimum(distance[:, -1:], reach) if k > neighbours else np.full((len(queries), 1), reach)
    weights = np.clip(1 - (distance / np.maximum(width, 1e-12)) ** 2, 0, None) ** 2
    # Where all neighbours are as far as the width, the nearest one alone is left.
    weights[:, 0] += 1e-12
    near = distance[:, 0] <= reach
    values = np.full((len(queries), strain.shape[1]), math.nan)
    shares = weights[near] / weights[near].sum(axis=1, keepdims=True)
    # One neighbour at a time: the strain of all at once would take k times the memory of the map.
    values[near] = sum(
        share[:, None] * strain[nearest] for share, nearest in zip(shares.T, index[near].T, strict=True)
    )
    return values
