"""Tracks of a scan: its sweeps, averaged over stretches."""

import numpy as np
from support.scans import raster

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
