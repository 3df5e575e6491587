"""Tracks of a scan: its sweeps, averaged over stretches."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.scans import raster

from tactile_localizer.core.geometry.motion import YAW_LEVER
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tracks import PITCH, Tracks
from tactile_localizer.scene import Axis, Phalanx, Scene

PLANE = Scene("plane", (Axis("x", 0.0, 0.03), Axis("y", 0.0, 0.03)), (Phalanx("index", (0.0, 0.0)),))
SLOPE = np.arange(2.0, 18.0).reshape(2, 8)


def lines() -> Scan:
    return raster(PLANE, lambda states, _: 1.0 + states @ SLOPE, 0.003, 0.0, 0.0001)


def test_points_of_a_track_are_a_pitch_apart() -> None:
    tracks = Tracks.of(lines(), PLANE)
    steps = np.linalg.norm(np.diff(tracks.positions[tracks.slices[2]], axis=0), axis=1)
    np.testing.assert_allclose(steps[:-2], PITCH, atol=1e-4 + 1e-9)
    np.testing.assert_allclose(tracks.strain, 1.0 + tracks.positions @ SLOPE, atol=1e-12)


def test_a_hand_at_rest_adds_no_points() -> None:
    scan = lines()
    rows = np.concatenate([np.arange(50), np.full(1000, 50), np.arange(51, len(scan))])
    rested, moved = (Tracks.of(each, PLANE).positions for each in (scan.select(rows), scan))
    np.testing.assert_allclose(rested, moved, atol=PITCH)
    assert Tracks.of(scan.select(np.zeros(30, dtype=int)), PLANE).counts.tolist() == [1]


def test_the_nearest_point_of_each_track() -> None:
    tracks = Tracks.of(lines(), PLANE)
    place = np.array([[0.0102, 0.0071]])
    distance, point = tracks.nearest(place, np.array([1, 4]))
    away = np.linalg.norm(tracks.positions - place, axis=1)
    np.testing.assert_allclose(distance[0], [away[tracks.slices[row]].min() for row in (1, 4)])
    np.testing.assert_allclose(away[point[0]], distance[0])


@given(st.integers(0, 2**32 - 1), st.booleans(), st.sampled_from([1, 300, 10**9]))
def test_the_nearest_points_are_those_of_all_distances(seed: int, turns: bool, at_once: int) -> None:
    rng = np.random.default_rng(seed)
    yaw = Axis("yaw", -np.pi, np.pi) if turns else Axis("yaw", 0.0, 1.0)
    scene = Scene("turn", (Axis("x", 0.0, 0.2), yaw), (Phalanx("index", (0.0, 0.0)),))
    counts = rng.integers(1, 20, rng.integers(1, 12))
    along = np.repeat(rng.random((len(counts), 2)), counts, axis=0) + 0.02 * rng.random((counts.sum(), 2))
    positions = scene.lower + scene.extent * along
    tracks = Tracks(scene, positions, np.zeros((len(along), 8)), counts)
    places = scene.lower + scene.extent * rng.random((30, 2))
    of = np.sort(rng.permutation(len(counts))[: rng.integers(1, len(counts) + 1)])
    away = (places[:, None] - positions) * [1.0, YAW_LEVER]
    if turns:
        away[..., 1] -= 2.0 * np.pi * YAW_LEVER * np.rint(away[..., 1] / (2.0 * np.pi * YAW_LEVER))
    away = np.linalg.norm(away, axis=2)
    expected = np.stack([away[:, tracks.slices[row]].min(axis=1) for row in of], axis=1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tactile_localizer.core.scan.tracks._MOST_DISTANCES", at_once)
        distance, point = tracks.nearest(places, of)
        few, points = tracks.nearest(places, of, 3)
    np.testing.assert_allclose(distance, expected, atol=1e-15)
    np.testing.assert_array_equal(tracks.number[point], of + 0 * point)
    np.testing.assert_allclose(np.take_along_axis(away, point, axis=1), expected, atol=1e-15)
    np.testing.assert_allclose(few, np.sort(expected, axis=1)[:, :3], atol=1e-15)
    np.testing.assert_allclose(np.take_along_axis(away, points, axis=1), few, atol=1e-15)
