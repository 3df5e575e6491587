"""Tracks of a scan, and interpolation between them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.scans import raster

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tracks import (
    PITCH,
    Track,
    expectation,
    tracks_of,
)
from tactile_localizer.scene import Axis, Phalanx, Scene

SIDE, SPACING = 0.03, 0.003
PLANE = Scene("plane", (Axis("x", 0.0, SIDE), Axis("y", 0.0, SIDE)), (Phalanx("index", (0.0, 0.0)),))
LINE = Scene("line", (Axis("x", 0.0, SIDE),), (Phalanx("index", (0.0,)),))


def sloping(states: np.ndarray) -> np.ndarray:
    """Strains (N, 8) that depend linearly on the state."""
    return 1.0 + states @ np.arange(2.0, 2.0 + 8 * states.shape[1]).reshape(states.shape[1], 8)


def lines(step: float = 0.0001) -> Scan:
    return raster(PLANE, lambda states, _: sloping(states), SPACING, 0.0, step)


def inside(count: int, seed: int = 0) -> np.ndarray:
    """Places (count, 2) within the lines."""
    return 0.002 + np.random.default_rng(seed).random((count, 2)) * (0.025 - 0.002)


def test_points_of_a_track_are_a_pitch_apart() -> None:
    track = tracks_of(lines(), PLANE)[2]
    steps = np.linalg.norm(np.diff(track.positions, axis=0), axis=1)
    np.testing.assert_allclose(steps[:-2], PITCH, atol=1e-4 + 1e-9)
    np.testing.assert_allclose(track.strain, sloping(track.positions), atol=1e-12)


def test_a_hand_at_rest_adds_no_points() -> None:
    scan = lines()
    rows = np.concatenate([np.arange(50), np.full(1000, 50), np.arange(51, len(scan))])
    rested, moved = (tracks_of(each, PLANE)[0].positions for each in (scan.select(rows), scan))
    np.testing.assert_allclose(rested, moved, atol=PITCH)
    still = scan.select(np.zeros(30, dtype=int))
    assert len(tracks_of(still, PLANE)[0].positions) == 1


def test_linear_strains_are_interpolated_exactly() -> None:
    places = inside(200)
    expected = expectation(tracks_of(lines(), PLANE), PLANE, places, SPACING, 1)
    np.testing.assert_allclose(expected.mean[:, 0], sloping(places), rtol=1e-9)


@given(st.permutations(range(10)))
def test_the_order_of_the_sweeps_is_irrelevant(order: list[int]) -> None:
    scan = lines(0.0005)
    noisy = scan.strain + np.random.default_rng(1).standard_normal(scan.strain.shape)
    tracks = tracks_of(Scan(scan.states, noisy, scan.sweep, scan.axes, scan.phalanges), PLANE)
    places = inside(40)
    one = expectation(tracks, PLANE, places, SPACING, 3)
    other = expectation([tracks[index] for index in order], PLANE, places, SPACING, 3)
    for mine, theirs in zip(one, other, strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-9)


def test_repeats_on_one_axis_are_averaged() -> None:
    x = np.arange(0.0, 0.02, 0.0005)[:, None]
    short, long = Track(x[:20], np.zeros((20, 8))), Track(x, np.ones((40, 8)))
    expected = expectation([short, long], LINE, np.array([[0.004], [0.018]]), 0.0, 1)
    np.testing.assert_allclose(expected.mean[:, 0, 0], [0.5, 1.0])
    np.testing.assert_allclose(expected.noise[:, 0], [0.5, 1.0])


def test_interpolation_error_grows_beyond_the_ends_of_tracks() -> None:
    x = np.arange(0.0, 0.02, 0.0005)[:, None]
    expected = expectation([Track(x, np.ones((40, 8)))] * 2, LINE, np.array([[0.01], [0.03]]), 0.0, 1)
    assert expected.interpolation_error[0].max() == 0.0
    assert expected.interpolation_error[1].min() > 1.0


def test_interpolation_across_the_wrap_of_yaw() -> None:
    scene = Scene("turn", (Axis("x", 0.0, SIDE), Axis("yaw", -np.pi, np.pi)), (Phalanx("index", (0.0, 0.0)),))
    x = np.arange(0.0, SIDE, 0.0005)
    yaws = (np.pi - 0.05, -np.pi + 0.05)
    tracks = [Track(np.column_stack([x, np.full_like(x, yaw)]), np.full((len(x), 8), yaw)) for yaw in yaws]
    place = np.array([[0.01, -np.pi + 1e-6]])
    expected = expectation(tracks, scene, place, 0.002, 1)
    assert expected.mean[0, 0, 0] == pytest.approx(0.0, abs=1e-3)
    assert expected.distance[0] == pytest.approx(0.05 * 0.02, abs=1e-6)


@pytest.mark.parametrize("dimension", [1, 2])
def test_interpolation_in_parts_gives_the_same_result(
    monkeypatch: pytest.MonkeyPatch, dimension: int
) -> None:
    rng = np.random.default_rng(0)
    axes = tuple(Axis(name, 0.0, 0.5, 0.003) for name in ("x", "y")[:dimension])
    wide = Scene("wide", axes, (Phalanx("a", (0.0,) * dimension),))
    starts = rng.uniform(0.0, 0.45, (60, 1, dimension))
    along = np.linspace(0.0, 0.05, 40)[:, None] * np.eye(dimension)[-1]
    tracks = [Track(start + along, rng.standard_normal((40, 8))) for start in starts]
    places = rng.uniform(0.0, 0.5, (300, dimension))
    whole = expectation(tracks, wide, places, 0.01, 3)
    for limit, value in (("_PLACES_AT_ONCE", 20), ("_EXTRA_CANDIDATES", 1000)):  # then, all are
        monkeypatch.setattr(f"tactile_localizer.core.scan.tracks.{limit}", value)
        for part, found in zip(whole, expectation(tracks, wide, places, 0.01, 3), strict=True):
            np.testing.assert_allclose(found, part, rtol=1e-12, atol=1e-15)
