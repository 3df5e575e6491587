"""Tracks: the sweeps of a scan, averaged over equal stretches."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene

PITCH = 0.0005
"""Least distance between two points of a track, m: finer than any load cell resolves."""
_ROUNDING = 1e-6
"""Fraction by which rounding may shorten a distance: a scan may have a strain at each pitch."""
_MARGIN = 1e-9
"""Fraction by which rounding may change a bound of distances."""
_MOST_DISTANCES = 2**17
"""Distances that are computed at once; of more, most are those of points that are far away."""


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
        positions, strain = scan.positions_on(scene) * levers(scene), scan.strain_on(scene)
        means = [
            _means_over_stretches(np.hstack([positions[rows], strain[rows]]), positions[rows])
            for rows in scan.rows_by_sweep
        ]
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
    def in_metres(self) -> np.ndarray:
        """Positions (d, n) in metres of travel: sums over a short last axis take several times longer."""
        return np.ascontiguousarray((self.positions * levers(self.scene)).T)

    def apart(self, difference: np.ndarray) -> np.ndarray:
        """Differences (d, ...) of positions in metres, by the shortest arc where an axis is a full turn."""
        for along, turn in zip(difference, self.turns.tolist(), strict=True):
            if turn:
                along -= turn * np.rint(along / turn)
        return difference

    def nearest(
        self, places: np.ndarray, of: np.ndarray | None = None, most: int | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Distances, m, of places (M, d) from the nearest point of each track; and these points: both (M, S).

        Parameters
        ----------
        places : positions; the nearer to each other they are, the sooner their tracks are found
        of : (S,) int, the tracks that are asked for; ``None``: all
        most : the nearest so many for each place, the nearest first; ``None``: all of them, in their order
        """
        if of is None:
            points = np.arange(len(self.positions))
        else:
            asked = np.zeros(len(self), dtype=bool)
            asked[of] = True
            points = np.flatnonzero(asked.repeat(self.counts))
        queries = np.ascontiguousarray((places * levers(self.scene)).T)
        shape = len(places), min(most or len(self), len(self) if of is None else len(of))
        squared, nearest = np.empty(shape), np.empty(shape, dtype=np.intp)
        waiting = [(np.arange(len(places)), points)]
        while waiting:
            rows, points = waiting.pop()
            points = self._near(queries[:, rows], points, most)
            if len(rows) > 1 and len(rows) * len(points) > _MOST_DISTANCES:
                waiting += [(half, points) for half in halves(queries.T, rows)]
                continue
            least, found = self._least(queries[:, rows], points)
            if most is not None:
                order = np.argsort(least, axis=1, kind="stable")[:, :most]
                least, found = (np.take_along_axis(each, order, axis=1) for each in (least, found))
            squared[rows], nearest[rows] = least, found
        return np.sqrt(squared), nearest

    def _near(self, queries: np.ndarray, points: np.ndarray, most: int | None) -> np.ndarray:
        """Those of ``points`` (n,) int that can be a track's nearest to one of ``queries`` (d, m), m.

        By the triangle inequality: a point that is nearest to a query is at most twice as far from the middle
        of all queries as the query is, beyond the point that is nearest to this middle.
        """
        middle = 0.5 * (queries.min(axis=1) + queries.max(axis=1))[:, None]
        reach = 2.0 * math.sqrt(np.square(queries - middle).sum(axis=0).max()) * (1.0 + _MARGIN)
        distance = np.sqrt(self._squared(middle, points)[0])
        starts = _starts(self.number[points])
        counts, least = np.diff([*starts, len(points)]), np.minimum.reduceat(distance, starts)
        limit = least * (1.0 + _MARGIN) + reach
        if most is not None and most < len(least):
            limit[least > np.partition(limit, most - 1)[most - 1]] = -1.0
        return points[distance <= limit.repeat(counts)]

    def _least(self, queries: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Squared distances (m, S), m^2, of ``queries`` (d, m) from the tracks of ``points`` (n,) int.

        And the nearest of the points of each track.
        """
        squared, starts = self._squared(queries, points), _starts(self.number[points])
        least = np.minimum.reduceat(squared, starts, axis=1)
        is_least = squared == least.repeat(np.diff([*starts, len(points)]), axis=1)
        hits = np.flatnonzero(is_least)  # of two that are equally near, the first one
        query, column = np.divmod(hits, len(points))
        first = _starts(query * len(self) + self.number[points[column]])
        return least, points[column[first]].reshape(least.shape)

    def _squared(self, queries: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Squared distances (m, n), m^2, of ``queries`` (d, m) from ``points`` (n,) int."""
        away = self.apart(queries[:, :, None] - self.in_metres.take(points, axis=1)[:, None])
        return np.asarray(np.square(away, out=away).sum(axis=0))


def halves(points: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The ``rows`` (m,) of points (n, d) in two halves, across the axis on which they extend farthest."""
    along = points[rows, np.ptp(points[rows], axis=0).argmax()]
    order, half = along.argsort(kind="stable"), len(rows) // 2
    return rows[order[half:]], rows[order[:half]]


def _starts(numbers: np.ndarray) -> np.ndarray:
    """First index of each stretch of equal ones among ``numbers`` (n,), non-negative."""
    return np.flatnonzero(np.diff(numbers, prepend=-1))


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
