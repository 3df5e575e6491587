"""Tracks, the sweeps of a scan averaged over equal stretches, and interpolation between them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene

PITCH = 0.0005
"""Least distance between two points of a track, m: finer than any load cell resolves."""

PAIRS = 6
"""Pairs of tracks from which a place is interpolated: the components of its mixture. With two passes over
each line three pairs leave one pass out."""
_NEAREST = 8
"""Tracks from which a place is interpolated, four on either side of it."""
_EXTRA_CANDIDATES = 2
"""Further candidates for them: the distance to a track's points is larger than that to the line between."""
_PENALTY_PER_LINE = 0.2
"""nats by which the prior of a pair falls for each line between its two tracks. Such pairs are components
because the nearest two need not be in the deformation mode of the next sweep. By judgement."""
_PENALTY_OUTSIDE = 16.0
"""nats by which the prior of a pair falls at one line spacing outside of it, squared with the distance."""
_PLACES_AT_ONCE = 2048
"""Neighbouring places interpolated together, which bounds memory."""


class Track(NamedTuple):
    """One sweep: ``positions`` (n, d), m (yaw: rad), and ``strain`` (n, C), in the order of travel."""

    positions: np.ndarray
    strain: np.ndarray


class Expectation(NamedTuple):
    """Expected strains at M places, as mixtures of K components.

    Parameters
    ----------
    mean : (M, K, C) strain
    interpolation_error : (M, K, C) squared difference of the two tracks, scaled by l (1 - l) with l the
        fraction of the way from one to the other
    noise : (M, K) variance of the mean, in units of the noise of one visit
    log_prior : (M, K) logarithms of the components' prior probabilities
    distance : (M,) from the place to the nearest track, m
    """

    mean: np.ndarray
    interpolation_error: np.ndarray
    noise: np.ndarray
    log_prior: np.ndarray
    distance: np.ndarray


def tracks_of(scan: Scan, scene: Scene) -> list[Track]:
    """The sweeps of a scan, averaged over stretches of :data:`PITCH`; a sweep without motion is one point."""
    positions = scan.positions_on(scene) * levers(scene)
    strain = scan.strain_on(scene)
    tracks = []
    order = np.argsort(scan.sweep, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(scan.sweep[order])) + 1):
        stretch = _stretches(positions[rows])
        count = np.bincount(stretch)[:, None]
        means = [
            np.stack([np.bincount(stretch, column) for column in values[rows].T], axis=1) / count
            for values in (positions, strain)
        ]
        tracks.append(Track(means[0] / levers(scene), means[1]))
    return tracks


def evenly(count: int, most: int) -> list[int]:
    """At most ``most`` numbers below ``count``, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)).tolist()


def expectation(
    tracks: Sequence[Track], scene: Scene, places: np.ndarray, spacing: float, components: int = PAIRS
) -> Expectation:
    """Expected strains at ``places`` (M, d), interpolated between the tracks around each.

    On one axis the tracks repeat one line, and their mean is the only component. On more axes the components
    are up to ``components`` pairs of tracks, each interpolated linearly. ``spacing`` is that of the lines, m.
    """
    scale, count = levers(scene), _NEAREST + _EXTRA_CANDIDATES
    trees = [cKDTree(track.positions * scale) for track in tracks]
    repeats = scene.dimension == 1 or len(tracks) == 1
    wraps = bool(scene.wraps.any())
    every = repeats or wraps or len(tracks) <= 2 * count
    tiles = list(_tiles(places * scale))
    parts = []
    for tile in tiles:
        here = places[tile]
        rows = range(len(tracks)) if every else _near(trees, count, here * scale)
        own, near = [tracks[row] for row in rows], [trees[row] for row in rows]
        if wraps:
            near = [cKDTree(_unwrapped(track.positions, scene, here) * scale) for track in own]
        strain = np.concatenate([track.strain for track in own])
        feet = _feet(near, strain, here * scale, every=repeats)
        if repeats:
            parts.append(_repeats(feet))
        else:
            parts.append(_pairs(feet, here * scale, max(spacing, PITCH), components))
    if len(tiles) == 1:
        return parts[0]
    back = np.argsort(np.concatenate(tiles))
    return Expectation(*(np.concatenate(values)[back] for values in zip(*parts, strict=True)))


def _tiles(points: np.ndarray) -> Iterator[np.ndarray]:
    """Indices of neighbouring points of (M, d), at most :data:`_PLACES_AT_ONCE` at a time."""
    waiting = [np.arange(len(points))]
    while waiting:
        rows = waiting.pop()
        if len(rows) <= _PLACES_AT_ONCE:
            yield rows
            continue
        along = points[rows, np.ptp(points[rows], axis=0).argmax()]
        order, half = along.argsort(kind="stable"), len(rows) // 2
        waiting += [rows[order[half:]], rows[order[:half]]]


def _near(trees: Sequence[cKDTree], count: int, places: np.ndarray) -> list[int]:
    """Indices of the trees of tracks that can be among the ``count`` nearest of any of ``places`` (m, d)."""
    centre = 0.5 * (places.min(axis=0) + places.max(axis=0))
    reach = 2.0 * float(np.sqrt(np.square(places - centre).sum(axis=1).max()))
    distance = np.array([tree.query(centre)[0] for tree in trees])
    limit = np.partition(distance, count - 1)[count - 1] + reach
    return np.flatnonzero(distance <= limit * (1.0 + 1e-9)).tolist()


def _stretches(positions: np.ndarray) -> np.ndarray:
    """Index (n,) of the stretch, at least one pitch long, to which each of the points (n, d) belongs."""
    numbers = np.zeros(len(positions), dtype=np.intp)
    points = positions.tolist()
    anchor, current = points[0], 0
    for index, point in enumerate(points):
        if math.dist(point, anchor) >= PITCH:
            anchor, current = point, current + 1
        numbers[index] = current
    return numbers


class _Projections(NamedTuple):
    """Feet of the perpendiculars from M places on the T nearest tracks, between the tracks' points.

    T is at most :data:`_NEAREST`, on one axis all tracks; the nearest is first.

    Parameters
    ----------
    position : (d, M, T) m
    strain : (M, T, C)
    distance : (M, T) m
    """

    position: np.ndarray
    strain: np.ndarray
    distance: np.ndarray


def _feet(trees: Sequence[cKDTree], strains: np.ndarray, queries: np.ndarray, every: bool) -> _Projections:
    """Feet of ``queries`` (M, d), m, on the nearest of the tracks, or on every one, given as trees."""
    found = [tree.query(queries) for tree in trees]
    distance, index = (np.stack(each, axis=1) for each in zip(*found, strict=True))
    starts = np.cumsum([0, *(tree.n for tree in trees)])
    first, last = starts[:-1], starts[1:] - 1
    index = index + first
    rows = np.arange(len(queries))[:, None]
    if not every:
        nearest = np.argsort(distance, axis=1, kind="stable")[:, : _NEAREST + _EXTRA_CANDIDATES]
        index, first, last = index[rows, nearest], first[nearest], last[nearest]
    # (d, M, T), because sums over a short last axis take several times longer.
    joined = np.ascontiguousarray(np.concatenate([tree.data for tree in trees]).T)
    nodes = joined.take(index, axis=1)
    away = queries.T[:, :, None] - nodes
    foot, best = nodes, _dot(away, away)
    other, ratio = index, np.zeros(index.shape)
    for step in (-1, 1):
        beside = np.clip(index + step, first, last)
        edge = joined.take(beside, axis=1) - nodes
        length = _dot(edge, edge)
        along = np.clip(_dot(away, edge) / np.where(length > 0, length, 1.0), 0.0, 1.0)
        edge *= along
        left = away - edge
        squared = _dot(left, left)
        closer = squared < best
        best = np.where(closer, squared, best)
        foot = np.where(closer, nodes + edge, foot)
        other, ratio = np.where(closer, beside, other), np.where(closer, along, ratio)
    if not every:
        order = np.argsort(best, axis=1, kind="stable")[:, :_NEAREST]
        foot, best, ratio = foot[:, rows, order], best[rows, order], ratio[rows, order]
        index, other = index[rows, order], other[rows, order]
    strain = strains.take(index, axis=0)
    strain += ratio[..., None] * (strains.take(other, axis=0) - strain)
    return _Projections(foot, strain, np.sqrt(best))


def _dot(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Scalar products of vectors (d, ...), (...)."""
    return np.asarray(np.einsum("d...,d...->...", first, second))


def _unwrapped(positions: np.ndarray, scene: Scene, places: np.ndarray) -> np.ndarray:
    """Positions (n, d) with those of full-turn axes on the turn of the nearest of ``places`` (M, d)."""
    wraps = scene.wraps
    if not wraps.any():
        return positions
    near = places[cKDTree(places * levers(scene)).query(positions * levers(scene))[1]]
    return near + np.where(wraps, wrap_angle(positions - near), positions - near)


def _repeats(feet: _Projections) -> Expectation:
    """The mean of the tracks that reach a place; beyond their ends, of those that end nearest."""
    nearest = feet.distance.min(axis=1)
    reaches = (feet.distance <= nearest[:, None] + 2.0 * PITCH).astype(np.float64)
    count = reaches.sum(axis=1)
    mean = np.einsum("mt,mtc->mc", reaches, feet.strain) / count[:, None]
    excess = np.maximum(nearest - 2.0 * PITCH, 0.0)[:, None]
    error = (excess / (8.0 * PITCH)) ** 2 * mean**2
    return Expectation(mean[:, None], error[:, None], 1.0 / count[:, None], np.zeros((len(mean), 1)), nearest)


def _pairs(feet: _Projections, places: np.ndarray, spacing: float, components: int) -> Expectation:
    """The pairs of tracks with the highest prior for each place: those close to it and on either side."""
    pairs = list(combinations(range(feet.strain.shape[1]), 2))
    ratios, scores, outside = [], [], []
    of_track = [np.ascontiguousarray(each) for each in np.moveaxis(feet.position, 2, 0)]
    for first, second in pairs:
        edge, away = of_track[second] - of_track[first], places.T - of_track[first]
        length = _dot(edge, edge)
        ratio = _dot(away, edge) / np.where(length > 0.0, length, 1.0)
        ratio = np.where(length > 0.0, np.clip(ratio, 0.0, 1.0), 0.5)
        left = away - ratio * edge
        rest = np.sqrt(_dot(left, left)) / spacing
        further = np.maximum(np.sqrt(length) / spacing - 1.0, 0.0)
        scores.append(-_PENALTY_PER_LINE * further - _PENALTY_OUTSIDE * rest**2)
        ratios.append(ratio)
        outside.append(rest)
    score = np.stack(scores, axis=1)
    best = np.argsort(-score, axis=1, kind="stable")[:, :components]
    rows = np.arange(len(places))[:, None]
    ratio, rest = np.stack(ratios, axis=1)[rows, best], np.stack(outside, axis=1)[rows, best]
    one, other = np.moveaxis(np.array(pairs)[best], -1, 0)
    start, change = feet.strain[rows, one], feet.strain[rows, other] - feet.strain[rows, one]
    open_ = ratio * (1.0 - ratio) + rest**2
    chosen = score[rows, best]
    log_prior = chosen - np.logaddexp.reduce(chosen, axis=1, keepdims=True)
    noise = ratio**2 + (1.0 - ratio) ** 2
    return Expectation(
        start + ratio[..., None] * change,
        open_[..., None] * change**2,
        noise,
        log_prior,
        feet.distance[:, 0],
    )
