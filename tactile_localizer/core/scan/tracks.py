"""Sweeps as evenly spaced tracks, and what neighbouring tracks say of a place between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.geometry.motion import YAW_LEVER
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene

PITCH = 0.0005
"""Least distance between two points of a track, m: finer than any load cell resolves."""

_NEAREST = 6
"""Tracks around a place that are considered, three on either side of it."""
_PRIOR_PER_LINE = 0.5
"""nats that a pair of tracks loses for each further line it spans: the nearest two need not be in the same
deformation mode as the sweep that is to come. By judgement, not varied yet."""
_OUTSIDE = 16.0
"""nats that a pair loses at one line spacing from the place: it should lie between the two tracks."""


class Track(NamedTuple):
    """One sweep: ``positions`` (n, d), m (yaw: rad), and ``strain`` (n, C) there, in the order of travel."""

    positions: np.ndarray
    strain: np.ndarray


class Expectation(NamedTuple):
    """What tracks let one expect at M places, by K components.

    Parameters
    ----------
    mean : (M, K, C) strain
    doubt : (M, K, C) squared difference of the two tracks, times how far the place is from either:
        what interpolation leaves open
    noise : (M, K) variance of the mean in units of one visit's noise
    log_prior : (M, K) logarithms of the components' prior probabilities
    distance : (M,) from the place to the nearest track, m
    """

    mean: np.ndarray
    doubt: np.ndarray
    noise: np.ndarray
    log_prior: np.ndarray
    distance: np.ndarray


def lever(scene: Scene) -> np.ndarray:
    """Metres that one unit of each axis counts for in the distance between two states, (d,)."""
    return np.array([YAW_LEVER if axis.name == "yaw" else 1.0 for axis in scene.axes])


def tracks_of(scan: Scan, scene: Scene) -> list[Track]:
    """The sweeps of a scan with their strains averaged over stretches of :data:`PITCH`.

    A hand that rests adds nothing. A sweep that never moves is one point.
    """
    positions = scan.states[:, scene.columns(scan.axes)] * lever(scene)
    strain = scan.strain[:, scene.channels(scan.phalanges, scan.channels)]
    tracks = []
    for number in scan.sweep_numbers:
        rows = np.flatnonzero(scan.sweep == number)
        stretch = _stretches(positions[rows])
        count = np.bincount(stretch)[:, None]
        means = [
            np.stack([np.bincount(stretch, column) for column in values[rows].T], axis=1) / count
            for values in (positions, strain)
        ]
        tracks.append(Track(means[0] / lever(scene), means[1]))
    return tracks


def line_spacing(tracks: Sequence[Track], scene: Scene) -> float:
    """Median distance from a point to the nearest other track, m; zero where tracks run over each other."""
    if len(tracks) < 2:
        return 0.0
    scale = lever(scene)
    trees = [cKDTree(track.positions * scale) for track in tracks]
    nearest = []
    for index, track in enumerate(tracks):
        points = track.positions[:: max(1, len(track.positions) // 20)] * scale
        others = [tree.query(points)[0] for other, tree in enumerate(trees) if other != index]
        nearest.append(np.min(others, axis=0))
    return float(np.median(np.concatenate(nearest)))


def expectation(
    tracks: Sequence[Track], scene: Scene, places: np.ndarray, spacing: float, components: int
) -> Expectation:
    """What is to be felt at ``places`` (M, d), interpolated between the tracks around each.

    On one axis tracks repeat each other: their mean is the one component. On more axes the components are
    pairs of tracks on either side of the place, each interpolated linearly.
    """
    feet, strain, distance = _feet(tracks, scene, places)
    if scene.dimension == 1 or len(tracks) == 1:
        return _repeats(strain, distance)
    return _pairs(feet, strain, distance, places * lever(scene), max(spacing, PITCH), components)


def _stretches(positions: np.ndarray) -> np.ndarray:
    """Number of the stretch of at least one pitch that each of (n, d) points belongs to, (n,) from zero."""
    numbers = np.zeros(len(positions), dtype=np.intp)
    points = positions.tolist()
    anchor, current = points[0], 0
    for index, point in enumerate(points):
        if math.dist(point, anchor) >= PITCH:
            anchor, current = point, current + 1
        numbers[index] = current
    return numbers


def _feet(
    tracks: Sequence[Track], scene: Scene, places: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nearest point of each of the nearest tracks to each place, its strain there, and its distance.

    Shapes (M, T, d), (M, T, C) and (M, T), nearest first; T at most :data:`_NEAREST` but on one axis, where
    it is all tracks. Strains are linear between a track's points.
    """
    scale = lever(scene)
    wraps = scene.wraps
    queries = places * scale
    feet, strains = [], []
    for track in tracks:
        points = track.positions * scale
        if wraps.any():
            near = places[cKDTree(places * scale).query(points)[1]]
            turned = near + np.where(wraps, wrap_angle(track.positions - near), track.positions - near)
            points = turned * scale
        index = cKDTree(points).query(queries)[1]
        foot, strain = points[index], track.strain[index]
        best = np.sum((queries - foot) ** 2, axis=1)
        for step in (-1, 1):
            other = np.clip(index + step, 0, len(points) - 1)
            edge = points[other] - points[index]
            length = np.sum(edge**2, axis=1)
            ratio = np.sum((queries - points[index]) * edge, axis=1) / np.where(length > 0, length, 1.0)
            ratio = np.clip(ratio, 0.0, 1.0)[:, None]
            candidate = points[index] + ratio * edge
            squared = np.sum((queries - candidate) ** 2, axis=1)
            closer = squared < best
            best = np.where(closer, squared, best)
            foot = np.where(closer[:, None], candidate, foot)
            between = track.strain[index] + ratio * (track.strain[other] - track.strain[index])
            strain = np.where(closer[:, None], between, strain)
        feet.append(foot)
        strains.append(strain)
    all_feet, all_strains = np.stack(feet, axis=1), np.stack(strains, axis=1)
    distance = np.sqrt(np.sum((all_feet - queries[:, None]) ** 2, axis=2))
    if scene.dimension > 1 and len(tracks) > 1:
        order = np.argsort(distance, axis=1, kind="stable")[:, :_NEAREST]
        rows = np.arange(len(places))[:, None]
        return all_feet[rows, order], all_strains[rows, order], distance[rows, order]
    return all_feet, all_strains, distance


def _repeats(strain: np.ndarray, distance: np.ndarray) -> Expectation:
    """The mean of the tracks that reach a place; beyond their ends, of those that end nearest."""
    nearest = distance.min(axis=1)
    reaches = (distance <= nearest[:, None] + 2.0 * PITCH).astype(np.float64)
    count = reaches.sum(axis=1)
    mean = np.einsum("mt,mtc->mc", reaches, strain) / count[:, None]
    excess = np.maximum(nearest - 2.0 * PITCH, 0.0)[:, None]
    doubt = (excess / (8.0 * PITCH)) ** 2 * mean**2
    return Expectation(mean[:, None], doubt[:, None], 1.0 / count[:, None], np.zeros((len(mean), 1)), nearest)


def _pairs(
    feet: np.ndarray,
    strain: np.ndarray,
    distance: np.ndarray,
    places: np.ndarray,
    spacing: float,
    components: int,
) -> Expectation:
    """The best pairs of tracks for each place, by how well they enclose it and how close they are."""
    pairs = list(combinations(range(feet.shape[1]), 2))
    ratios, scores, outside = [], [], []
    for first, second in pairs:
        edge = feet[:, second] - feet[:, first]
        length = np.sum(edge**2, axis=1)
        ratio = np.sum((places - feet[:, first]) * edge, axis=1) / np.where(length > 0.0, length, 1.0)
        ratio = np.where(length > 0.0, np.clip(ratio, 0.0, 1.0), 0.5)
        rest = np.sqrt(np.sum((places - feet[:, first] - ratio[:, None] * edge) ** 2, axis=1)) / spacing
        further = np.maximum(np.sqrt(length) / spacing - 1.0, 0.0)
        scores.append(-_PRIOR_PER_LINE * further - _OUTSIDE * rest**2)
        ratios.append(ratio)
        outside.append(rest)
    score = np.stack(scores, axis=1)
    best = np.argsort(-score, axis=1, kind="stable")[:, :components]
    rows = np.arange(len(places))[:, None]
    ratio, rest = np.stack(ratios, axis=1)[rows, best], np.stack(outside, axis=1)[rows, best]
    ends = np.array(pairs)[best]
    first, second = strain[rows, ends[..., 0]], strain[rows, ends[..., 1]]
    mean = first + ratio[..., None] * (second - first)
    open_ = ratio * (1.0 - ratio) + rest**2
    chosen = score[rows, best]
    log_prior = chosen - np.logaddexp.reduce(chosen, axis=1, keepdims=True)
    noise = ratio**2 + (1.0 - ratio) ** 2
    return Expectation(mean, open_[..., None] * (second - first) ** 2, noise, log_prior, distance[:, 0])
