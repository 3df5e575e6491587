"""Interpolation of strains between the tracks of a scan.

The weights of the tracks' points depend on positions alone: they are computed once and used for strains in
volts, without their levels, or whitened.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.core.scan.tracks import PITCH, Tracks, evenly, halves

PAIRS = 6
"""Pairs of tracks from which a place is interpolated: the components of its mixture. With two passes over
each line three pairs leave one pass out."""
_NEAREST = 8
"""Tracks, by their points, from which a place is interpolated, four on either side of it."""
_PENALTY_PER_LINE = 0.2
"""nats by which the prior of a pair falls for each line between its two tracks. Such pairs are components
because the nearest two need not be in the deformation mode of the next sweep. By judgement."""
_PENALTY_OUTSIDE = 16.0
"""nats by which the prior of a pair falls at one line spacing outside of it, squared with the distance."""
_PLACES_AT_ONCE = 2048
"""Neighbouring places interpolated together, which bounds memory."""
_MAX_HELD_OUT = 100
"""Largest number of tracks that are compared with the others, which suffices for a few dozen parameters."""


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

    @property
    def average(self) -> np.ndarray:
        """Expected strains (M, C), averaged over the components."""
        return np.asarray(np.einsum("mk,mkc->mc", np.exp(self.log_prior), self.mean))


class Interpolation(NamedTuple):
    """Weights of the points of tracks, from which strains at M places are interpolated with K components.

    Parameters
    ----------
    points : (M, K, P) int, P points for each component
    weights : (M, K, P) of their strains in the mean
    difference : (M, K, P) weights in the difference whose square is the interpolation error
    noise, log_prior, distance : as in :class:`Expectation`
    """

    points: np.ndarray
    weights: np.ndarray
    difference: np.ndarray
    noise: np.ndarray
    log_prior: np.ndarray
    distance: np.ndarray

    def expected(self, strain: np.ndarray) -> Expectation:
        """Expected strains, where the tracks' points have ``strain`` (n, C)."""
        from scipy.sparse import csr_array

        count, shape = self.points.shape[-1], (*self.points.shape[:2], strain.shape[1])
        starts = np.arange(0, self.points.size + 1, count)

        def summed(weights: np.ndarray) -> np.ndarray:
            matrix = csr_array(
                (weights.ravel(), self.points.ravel(), starts), shape=(len(starts) - 1, len(strain))
            )
            return np.asarray(matrix @ strain).reshape(shape)

        error = np.square(summed(self.difference))
        return Expectation(summed(self.weights), error, self.noise, self.log_prior, self.distance)

    def best(self, components: int) -> Interpolation:
        """The components with the highest prior alone."""
        kept = Interpolation(*(each[:, :components] if each.ndim > 1 else each for each in self))
        total = np.logaddexp.reduce(kept.log_prior, axis=1, keepdims=True)
        return kept._replace(log_prior=kept.log_prior - total)

    def at(self, rows: np.ndarray) -> Interpolation:
        """Some of the places, by index."""
        return Interpolation(*(each[rows] for each in self))


class HeldOut(NamedTuple):
    """Tracks that are held out one at a time, and interpolated between the others.

    Parameters
    ----------
    points : (m,) of the tracks that are held out
    slices : of each of them among these points
    interpolation : at these points
    """

    points: np.ndarray
    slices: list[slice]
    interpolation: Interpolation


def hold_out(tracks: Tracks, spacing: float) -> HeldOut:
    """Interpolate along at most :data:`_MAX_HELD_OUT` of at least two tracks between the other ones."""
    held = evenly(len(tracks), _MAX_HELD_OUT)
    points, numbers = np.arange(len(tracks.positions)), np.arange(len(tracks))
    parts = [
        interpolate(tracks, tracks.positions[tracks.slices[index]], spacing, without=numbers == index)
        for index in held
    ]
    ends = np.cumsum(tracks.counts[held])
    slices = [slice(*part) for part in zip(ends - tracks.counts[held], ends, strict=True)]
    interpolation = Interpolation(*(np.concatenate(values) for values in zip(*parts, strict=True)))
    return HeldOut(points[np.isin(tracks.number, held)], slices, interpolation)


def interpolate(
    tracks: Tracks,
    places: np.ndarray,
    spacing: float,
    without: np.ndarray | None = None,
) -> Interpolation:
    """Interpolate at ``places`` (M, d) that are near each other, between the tracks around each.

    On one axis the tracks repeat one line, and their mean is the only component. On more axes the components
    are up to :data:`PAIRS` pairs of tracks, each interpolated linearly. ``spacing`` is that of the lines, m;
    the tracks ``without`` (S,) bool are left out.
    """
    none = np.zeros(len(tracks), dtype=bool)
    return next(interpolations(tracks, places, spacing, [none if without is None else without]))


def interpolations(
    tracks: Tracks, places: np.ndarray, spacing: float, without: Sequence[np.ndarray]
) -> Iterator[Interpolation]:
    """The same without each of several sets of tracks (S,) bool; one search serves all that are small."""
    most, searched = _NEAREST + max(int(np.count_nonzero(out)) for out in without), None
    if len(without) > 1 and most <= 2 * _NEAREST and tracks.scene.dimension > 1:
        searched = _project(tracks, places, np.arange(len(tracks)), most)
    for out in without:
        kept = np.flatnonzero(~out)
        if tracks.scene.dimension == 1 or len(kept) == 1:
            yield _repeats(_project(tracks, places, kept, None))
            continue
        if searched is None:
            feet = _project(tracks, places, kept, _NEAREST)
        else:
            feet = searched.of(~out[tracks.number[searched.points[0]]], min(_NEAREST, len(kept)))
        yield _pairs(feet, max(spacing, PITCH))


def tiles(points: np.ndarray) -> Iterator[np.ndarray]:
    """Indices of neighbouring points of (M, d), at most :data:`_PLACES_AT_ONCE` at a time."""
    waiting = [np.arange(len(points))]
    while waiting:
        rows = waiting.pop()
        if len(rows) <= _PLACES_AT_ONCE:
            yield rows
            continue
        waiting += halves(points, rows)


class _Projections(NamedTuple):
    """Feet of the perpendiculars from M places on the T nearest tracks, between two points of each track.

    Parameters
    ----------
    offset : (d, M, T) m, of the foot from the place
    distance : (M, T) m
    points : (2, M, T) int, the two points
    weights : (2, M, T) of their strains at the foot
    """

    offset: np.ndarray
    distance: np.ndarray
    points: np.ndarray
    weights: np.ndarray

    def of(self, kept: np.ndarray, count: int) -> _Projections:
        """The first ``count`` of those that are ``kept`` (M, T) bool, at least so many of each place."""
        chosen = np.argsort(~kept, axis=1, kind="stable")[:, :count]
        rows = np.arange(len(chosen))[:, None]
        return _Projections(*(each[..., rows, chosen] for each in self))


def _project(tracks: Tracks, places: np.ndarray, kept: np.ndarray, most: int | None) -> _Projections:
    """Feet of ``places`` (M, d) on the nearest of the tracks ``kept``, so many, or all of them."""
    _, point = tracks.nearest(places, kept, most)
    first = tracks.starts[tracks.number[point]]
    last = first + tracks.counts[tracks.number[point]] - 1
    joined, apart = tracks.in_metres, tracks.apart
    nodes = joined.take(point, axis=1)
    away = apart(nodes - (places * levers(tracks.scene)).T[:, :, None])
    offset, best = away, _dot(away, away)
    other, ratio = point, np.zeros(point.shape)
    for step in (-1, 1):
        beside = np.clip(point + step, first, last)
        edge = apart(joined.take(beside, axis=1) - nodes)
        length = _dot(edge, edge)
        along = np.clip(-_dot(away, edge) / np.where(length > 0, length, 1.0), 0.0, 1.0)
        left = away + along * edge
        squared = _dot(left, left)
        closer = squared < best
        best, offset = np.where(closer, squared, best), np.where(closer, left, offset)
        other, ratio = np.where(closer, beside, other), np.where(closer, along, ratio)
    return _Projections(offset, np.sqrt(best), np.stack([point, other]), np.stack([1.0 - ratio, ratio]))


def _dot(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Scalar products of vectors (d, ...), (...)."""
    return np.asarray(np.einsum("d...,d...->...", first, second))


def _repeats(feet: _Projections) -> Interpolation:
    """The mean of the tracks that reach a place; beyond their ends, of those that end nearest."""
    nearest = feet.distance.min(axis=1)
    reaches = (feet.distance <= nearest[:, None] + 2.0 * PITCH).astype(np.float64)
    count = reaches.sum(axis=1)[:, None]
    places, tracks = feet.distance.shape
    points, weights = (
        np.moveaxis(each, 0, -1).reshape(places, 1, 2 * tracks)
        for each in (feet.points, feet.weights * reaches / count)
    )
    excess = np.maximum(nearest - 2.0 * PITCH, 0.0)[:, None, None] / (8.0 * PITCH)
    return Interpolation(points, weights, excess * weights, 1.0 / count, np.zeros((places, 1)), nearest)


def _pairs(feet: _Projections, spacing: float) -> Interpolation:
    """The pairs of tracks with the highest prior for each place: those close to it and on either side."""
    first, second = np.triu_indices(feet.distance.shape[1], 1)
    start, edge = feet.offset[:, :, first], feet.offset[:, :, second] - feet.offset[:, :, first]
    length = _dot(edge, edge)
    ratio = -_dot(start, edge) / np.where(length > 0.0, length, 1.0)
    ratio = np.where(length > 0.0, np.clip(ratio, 0.0, 1.0), 0.5)
    left = start + ratio * edge
    rest = _dot(left, left) / spacing**2
    further = np.maximum(np.sqrt(length) / spacing - 1.0, 0.0)
    score = -_PENALTY_PER_LINE * further - _PENALTY_OUTSIDE * rest
    best = np.argsort(-score, axis=1, kind="stable")[:, :PAIRS]
    rows = np.arange(len(best))[:, None]
    ratio, rest, score = ratio[rows, best], rest[rows, best], score[rows, best]
    pair = np.stack([first[best], second[best]])
    # (2, 2, M, K): the two points of either track.
    points, weights = feet.points[:, rows, pair], feet.weights[:, rows, pair]
    share = np.stack([1.0 - ratio, ratio])
    change = np.sqrt(ratio * (1.0 - ratio) + rest) * np.array([-1.0, 1.0])[:, None, None]
    points, weights, difference = (
        np.moveaxis(each.reshape(4, *best.shape), 0, -1)
        for each in (points, weights * share, weights * change)
    )
    log_prior = score - np.logaddexp.reduce(score, axis=1, keepdims=True)
    noise = np.square(share).sum(axis=0)
    return Interpolation(points, weights, difference, noise, log_prior, feet.distance.min(axis=1))
