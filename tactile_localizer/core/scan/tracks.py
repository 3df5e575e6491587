"""Tracks: the sweeps of a scan, averaged over equal stretches."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene

PITCH = 0.0005
"""Least distance between two points of a track, m: finer than any load cell resolves."""
_ROUNDING = 1e-6
"""Fraction by which rounding may shorten a distance: a scan may have a strain at each pitch."""


@dataclass(frozen=True)
class Tracks:
    """The S sweeps of a scan, one after another, as n points in the order of travel.

    Parameters
    ----------
    scene : axes, bounds and phalanges
    positions : (n, d) m (yaw: rad)
    strain : (n, C) V, as recorded
    counts : (S,) number of points of each track
    """

    scene: Scene
    positions: np.ndarray
    strain: np.ndarray
    counts: np.ndarray

    @classmethod
    def of(cls, scan: Scan, scene: Scene) -> Tracks:
        """Average the sweeps over stretches of :data:`PITCH`; a sweep without motion becomes one point.

        Raises
        ------
        SceneError
            The scene names an axis or a phalanx that the scan does not have.
        """
        positions = scan.positions_on(scene) * levers(scene)
        values = np.hstack([positions, scan.strain_on(scene)])
        order = np.argsort(scan.sweep, kind="stable")
        sweeps = np.split(order, np.flatnonzero(np.diff(scan.sweep[order])) + 1)
        means = [_means_over_stretches(values[rows], positions[rows]) for rows in sweeps]
        joined = np.concatenate(means)
        split = positions.shape[1]
        return cls(scene, joined[:, :split] / levers(scene), joined[:, split:], np.array([*map(len, means)]))

    def part(self, points: np.ndarray) -> tuple[Tracks, np.ndarray]:
        """Tracks of some ``points`` (n,) bool, each of successive ones; and of which they are parts."""
        kept = np.flatnonzero(points)
        begins = np.diff(kept, prepend=-2) > 1
        begins[1:] |= np.diff(self.number[kept]) > 0
        starts = np.flatnonzero(begins)
        counts = np.diff([*starts, len(kept)])
        part = Tracks(self.scene, self.positions[kept], self.strain[kept], counts)
        return part, self.number[kept[starts]]

    def __len__(self) -> int:
        return len(self.counts)

    @cached_property
    def starts(self) -> np.ndarray:
        """First point (S,) of each track."""
        return np.cumsum(self.counts) - self.counts

    @cached_property
    def slices(self) -> list[slice]:
        """Points of each track."""
        return [slice(*ends) for ends in zip(self.starts, self.starts + self.counts, strict=True)]

    @cached_property
    def number(self) -> np.ndarray:
        """Track (n,) of each point."""
        return np.repeat(np.arange(len(self)), self.counts)

    @cached_property
    def pitch(self) -> float:
        """Median distance between successive points of a track, m, at least :data:`PITCH`."""
        steps = np.diff(self.positions * levers(self.scene), axis=0)
        steps = steps[np.diff(self.number) == 0]
        return max(float(np.median(np.linalg.norm(steps, axis=1))), PITCH) if len(steps) else PITCH

    @cached_property
    def turns(self) -> np.ndarray:
        """Period (d,) of each axis, m; zero where it is no full turn."""
        return np.where(self.scene.wraps, 2.0 * math.pi * levers(self.scene), 0.0)

    @cached_property
    def _trees(self) -> list[cKDTree]:
        points, full = self.positions * levers(self.scene), self.turns > 0.0
        for _ in range(2):  # by rounding, the first remainder may be the period itself
            points[:, full] = np.mod(points[:, full], self.turns[full])
        return [cKDTree(points[rows], boxsize=self.turns if full.any() else None) for rows in self.slices]

    def nearest(self, places: np.ndarray, of: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Distances (M, S), m, of places (M, d) from the nearest point of each track; and these points.

        ``of`` are the tracks that are asked for; ``None``: all.
        """
        rows = np.arange(len(self)) if of is None else of
        queries = places * levers(self.scene)
        found = [self._trees[row].query(queries) for row in rows]
        distance, point = (np.stack(each, axis=1) for each in zip(*found, strict=True))
        return distance, point + self.starts[rows]


def evenly(count: int, most: int) -> list[int]:
    """At most ``most`` numbers below ``count``, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)).tolist()


def _means_over_stretches(values: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Means of values (n, ...) over stretches at least one pitch long, along positions (n, d) in metres."""
    starts, points = [0], positions.tolist()
    for index, point in enumerate(points):
        if math.dist(point, points[starts[-1]]) >= (1.0 - _ROUNDING) * PITCH:
            starts.append(index)
    counts = np.diff([*starts, len(points)])
    return np.asarray(np.add.reduceat(values, starts, axis=0) / counts[:, None])
