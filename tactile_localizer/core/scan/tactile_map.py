"""Tactile map (paper, II-B): the strains of a scan interpolated on a regular grid of palm positions."""

import math
from dataclasses import dataclass

import numpy as np

from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.geometry.phalanges import phalanx_positions
from tactile_localizer.core.scan.interpolation import interpolate, tiles
from tactile_localizer.core.scan.lines import line_spacing
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tracks import PITCH, Tracks
from tactile_localizer.scene import Phalanx, Scene

NODES = {1: 1200, 2: 120}
"""Nodes along the longer axis, for maps of one and of two axes."""


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


def make_map(scan: Scan, scene: Scene, tracks: Tracks | None = None) -> TactileMap:
    """Interpolate a scan on a regular grid over the scene's bounds, axes and phalanges.

    A node's value is the mean of what the measurement model interpolates there between the sweeps
    (:func:`.interpolate`), within 1.5 line spacings of a sweep. Of three axes the first two are shown, with
    the third at the median of the scan.

    ``tracks`` are those of the scan and the scene, where they are known.

    Raises
    ------
    SceneError
        The scene names an axis or a phalanx that the scan does not have.
    """
    from scipy.ndimage import binary_dilation, binary_erosion

    shown, tracks = min(scene.dimension, 2), tracks or Tracks.of(scan, scene)
    scale, spacing = levers(scene)[:shown], line_spacing(tracks)
    extent = scene.extent[:shown] * scale
    step = float(extent.max()) / (NODES[shown] - 1)
    counts = [max(2, math.floor(each / step + 1e-9) + 1) for each in extent]
    grid = tuple(
        np.linspace(low, high, count)
        for low, high, count in zip(scene.lower, scene.upper, counts, strict=False)
    )
    places = np.stack(np.meshgrid(*grid, indexing="ij"), axis=-1).reshape(-1, shown)
    third = np.median(scan.positions_on(scene)[:, shown:], axis=0)
    places = np.column_stack([places, np.tile(third, (len(places), 1))])
    values, distance = np.empty((len(places), tracks.strain.shape[1])), np.empty(len(places))
    for part in tiles(places * levers(scene)):
        found = interpolate(tracks, places[part], spacing).expected(tracks.strain)
        values[part], distance[part] = found.average, found.distance
    reach = max(1.5 * spacing, step, 2.0 * PITCH)
    near = (distance <= reach).reshape(counts)
    # Closed, because it has notches between the ends of two lines.
    element, times = np.ones([3] * shown), math.ceil(reach / step)
    near = binary_erosion(binary_dilation(near, element, times), element, times, border_value=1)
    values[~near.ravel()] = math.nan
    # A channel at a time: all at once are sorted in a copy.
    background = np.array([np.median(each) for each in scan.strain_on(scene).T])
    return TactileMap(scene, grid, values.reshape(*counts, -1), background)
