"""Tactile map (paper, II-B): the strains of a scan interpolated on a regular grid of palm positions."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.geometry.phalanges import phalanx_positions, turned_offsets
from tactile_localizer.core.scan.lines import line_spacing
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tracks import tracks_of
from tactile_localizer.scene import Phalanx, Scene

NODES = {1: 1200, 2: 120}
"""Nodes along the longer axis, for maps of one and of two axes."""

_NEIGHBOURS = 8
"""Neighbours from which a node is interpolated; the paper's k."""


@dataclass(frozen=True)
class TactileMap:
    """Strain on a regular grid over one or two axes of the scene.

    Parameters
    ----------
    scene : of which the first one or two axes are shown
    nodes : by axis, the palm positions of the grid's nodes, m (yaw: rad), ascending
    values : (n1, C) or (n1, n2, C) strain voltages, V; NaN where no pair is near enough
    background : (C,) strain of featureless material, V: the median over the scan's pairs
    """

    scene: Scene
    nodes: tuple[np.ndarray, ...]
    values: np.ndarray
    background: np.ndarray

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes that are shown, one or two."""
        return self.scene.axis_names[: len(self.nodes)]

    def phalanx(self, name: str) -> np.ndarray:
        """Strains of a phalanx minus their background, (..., channels), V."""
        columns = self.scene.layout.slices[self.scene.phalanx_names.index(name)]
        return self.values[..., columns] - self.background[columns]

    def places(self, phalanx: Phalanx) -> np.ndarray:
        """Positions of a phalanx with the palm at the nodes, (n1, 1) or (n1, n2, 2), m (yaw: rad)."""
        nodes = np.stack(np.meshgrid(*self.nodes, indexing="ij"), axis=-1)
        states = np.zeros((*nodes.shape[:-1], self.scene.dimension))
        states[..., : len(self.nodes)] = nodes
        placed = phalanx_positions(self.scene, phalanx, states.reshape(-1, self.scene.dimension))
        return placed.reshape(states.shape)[..., : len(self.nodes)]

    @property
    def covered(self) -> np.ndarray:
        """Whether each node has data, bool of the grid's shape."""
        return np.asarray(np.isfinite(self.values).all(axis=-1))


def make_map(scan: Scan, scene: Scene) -> TactileMap:
    """Interpolate a scan on a regular grid over the scene's bounds, axes and phalanges.

    A node's value is the mean of its nearest neighbours within 1.5 line spacings, with biweight weights
    that fall to zero at the next neighbour, so that the map is continuous. Pairs are first averaged over
    cells of half a line spacing, so that the neighbours lie on several sweeps and a slow palm does not
    outweigh a fast one. Of three axes the first two are shown, with the pairs at all values of the third;
    if that is yaw, each phalanx is shown at its own position: nodes are palm positions at yaw zero.

    Raises
    ------
    SceneError
        The scene names an axis or a phalanx that the scan does not have.
    """
    shown = min(scene.dimension, 2)
    scale, distance = levers(scene)[:shown], line_spacing(tracks_of(scan, scene), scene)
    lower, upper = scene.lower[:shown] * scale, scene.upper[:shown] * scale
    step = float(np.max(upper - lower)) / (NODES[shown] - 1)
    counts = [max(2, math.floor(extent / step + 1e-9) + 1) for extent in upper - lower]
    grid = tuple(np.linspace(low, high, count) for low, high, count in zip(lower, upper, counts, strict=True))
    palms = scan.positions_on(scene)
    scan = Scan(
        palms[:, :shown] * scale,
        scan.strain_on(scene),
        scan.sweep,
        scene.axis_names[:shown],
        scene.phalanx_names,
        scene.layout.counts,
    )
    cell = max(step, distance / 2)
    reach = max(1.5 * distance, 1.5 * _pair_distance(scan), cell)
    queries = np.stack(np.meshgrid(*grid, indexing="ij"), axis=-1).reshape(-1, shown)
    values = np.empty((len(queries), scan.strain.shape[1]))
    for columns, states in _shown_positions(scene, palms, shown):
        places, strain = _cell_means(states * scale, scan.strain[:, columns], lower, cell)
        values[:, columns] = _local_mean(places, strain, queries, reach)
    return TactileMap(
        scene=scene,
        nodes=tuple(nodes / unit for nodes, unit in zip(grid, scale, strict=True)),
        values=values.reshape(*counts, -1),
        background=np.median(scan.strain, axis=0),
    )


def _shown_positions(scene: Scene, palms: np.ndarray, shown: int) -> Iterator[tuple[slice, np.ndarray]]:
    """Columns of the strain, and the positions (N, shown) at which their pairs are shown."""
    if "yaw" not in scene.axis_names[shown:]:
        yield slice(None), palms[:, :shown]
        return
    for phalanx, columns in zip(scene.phalanges, scene.layout.slices, strict=True):
        moved = turned_offsets(scene, phalanx, palms) - np.asarray(phalanx.offset)
        yield columns, (palms + moved)[:, :shown]


def axis_scale(scene: Scene) -> np.ndarray:
    """Display scale of each axis, (d,): 1 for lengths; yaw is scaled to the extent of the longest of them."""
    extent = scene.extent
    angle = np.array([axis.name == "yaw" for axis in scene.axes])
    if angle.all() or not angle.any():
        return np.ones(len(extent))
    return np.where(angle, extent[~angle].max() / extent, 1.0)


def _pair_distance(scan: Scan) -> float:
    """Median distance of consecutive pairs of a sweep; 0 where no sweep has two."""
    steps = np.linalg.norm(np.diff(scan.states, axis=0), axis=1)[np.diff(scan.sweep) == 0]
    return float(np.median(steps)) if len(steps) else 0.0


def _cell_means(
    states: np.ndarray, strain: np.ndarray, lower: np.ndarray, size: float
) -> tuple[np.ndarray, np.ndarray]:
    """Mean state and strain of the pairs in each non-empty cell of a grid."""
    cells = np.floor((states - lower) / size).astype(np.int64)
    _, cell, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(cell.ravel(), kind="stable")
    starts = np.concatenate([[0], np.cumsum(count)[:-1]])
    means = [np.add.reduceat(values[order], starts) / count[:, None] for values in (states, strain)]
    return means[0], means[1]


def _local_mean(places: np.ndarray, strain: np.ndarray, queries: np.ndarray, reach: float) -> np.ndarray:
    """Weighted mean strain (Q, C) of the nearest places to each query; NaN beyond reach."""
    k = min(_NEIGHBOURS + 1, len(places))
    distance, index = cKDTree(places).query(queries, k=list(range(1, k + 1)))
    width = np.minimum(distance[:, -1:], reach) if k > _NEIGHBOURS else np.full((len(queries), 1), reach)
    weights = np.clip(1 - (distance / np.maximum(width, 1e-12)) ** 2, 0, None) ** 2
    weights[:, 0] += 1e-12  # the nearest one alone counts where all are at the width
    near = distance[:, 0] <= reach
    values = np.full((len(queries), strain.shape[1]), math.nan)
    weights = weights[near] / weights[near].sum(axis=1, keepdims=True)
    # One neighbour at a time: the strains of all of them would take k times the memory of the map.
    values[near] = sum(
        weight[:, None] * strain[nearest] for weight, nearest in zip(weights.T, index[near].T, strict=True)
    )
    return values
