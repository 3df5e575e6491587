"""Interpolation between the tracks of a scan."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.scans import raster

from tactile_localizer.core.geometry.motion import YAW_LEVER
from tactile_localizer.core.scan.interpolation import hold_out, interpolate, interpolations, tiles
from tactile_localizer.core.scan.tracks import Tracks
from tactile_localizer.scene import Axis, Phalanx, Scene

SIDE, SPACING = 0.03, 0.003
PLANE = Scene("plane", (Axis("x", 0.0, SIDE), Axis("y", 0.0, SIDE)), (Phalanx("index", (0.0, 0.0)),))
LINE = Scene("line", (Axis("x", 0.0, SIDE),), (Phalanx("index", (0.0,)),))
SLOPE = np.arange(2.0, 18.0).reshape(2, 8)
LINES = Tracks.of(raster(PLANE, lambda states, _: 1.0 + states @ SLOPE, SPACING, 0.0, 0.0005), PLANE)


def joined(scene: Scene, *tracks: tuple[np.ndarray, np.ndarray]) -> Tracks:
    """Tracks of positions (n, d) and strains (n, C)."""
    positions, strain = (np.concatenate(each) for each in zip(*tracks, strict=True))
    return Tracks(scene, positions, strain, np.array([len(each) for each, _ in tracks]))


def inside(count: int, seed: int = 0) -> np.ndarray:
    """Places (count, 2) within the lines."""
    return 0.002 + np.random.default_rng(seed).random((count, 2)) * (0.025 - 0.002)


def test_linear_strains_are_interpolated_exactly() -> None:
    places = inside(200)
    expected = interpolate(LINES, places, SPACING).expected(LINES.strain)
    np.testing.assert_allclose(expected.mean[:, 0], 1.0 + places @ SLOPE, rtol=1e-9)


@given(st.permutations(range(10)))
def test_the_order_of_the_sweeps_is_irrelevant(order: list[int]) -> None:
    strain, places = np.random.default_rng(1).standard_normal(LINES.strain.shape), inside(40)
    rows = np.concatenate([np.arange(len(strain))[LINES.slices[index]] for index in order])
    other = Tracks(PLANE, LINES.positions[rows], LINES.strain[rows], LINES.counts[order])
    mine = interpolate(LINES, places, SPACING).expected(strain)
    theirs = interpolate(other, places, SPACING).expected(strain[rows])
    for one, two in zip(mine, theirs, strict=True):
        np.testing.assert_allclose(one, two, atol=1e-9)


def test_a_track_that_is_held_out_is_not_interpolated_from() -> None:
    held_out, strain = hold_out(LINES, SPACING), np.eye(len(LINES))[LINES.number]
    assert len(held_out.slices) == len(LINES)
    np.testing.assert_array_equal(held_out.points, np.arange(len(LINES.positions)))
    expected = held_out.interpolation.expected(strain)
    assert (expected.mean[strain[held_out.points, None].repeat(6, axis=1) > 0.0] == 0.0).all()
    best = held_out.interpolation.best(2)
    np.testing.assert_array_equal(best.points, held_out.interpolation.points[:, :2])
    np.testing.assert_allclose(np.exp(best.log_prior).sum(axis=1), 1.0)


@given(st.lists(st.sets(st.integers(0, 9), max_size=9), min_size=1, max_size=4))
def test_one_search_leaves_out_each_of_several_sets_of_tracks(left_out: list[set[int]]) -> None:
    places, without = inside(40), [np.isin(np.arange(10), [*each]) for each in left_out]
    for out, found in zip(without, interpolations(LINES, places, SPACING, without), strict=True):
        kept, _ = LINES.part(~out[LINES.number])
        alone = interpolate(kept, places, SPACING)
        expected = alone.expected(LINES.strain[~out[LINES.number]])
        for one, two in zip(found.expected(LINES.strain), expected, strict=True):
            np.testing.assert_array_equal(one, two)


def test_repeats_on_one_axis_are_averaged() -> None:
    x = np.arange(0.0, 0.02, 0.0005)[:, None]
    tracks = joined(LINE, (x[:20], np.zeros((20, 8))), (x, np.ones((40, 8))))
    expected = interpolate(tracks, np.array([[0.004], [0.018]]), 0.0).expected(tracks.strain)
    np.testing.assert_allclose(expected.mean[:, 0, 0], [0.5, 1.0])
    np.testing.assert_allclose(expected.noise[:, 0], [0.5, 1.0])


def test_interpolation_error_grows_beyond_the_ends_of_tracks() -> None:
    x = np.arange(0.0, 0.02, 0.0005)[:, None]
    tracks = joined(LINE, *[(x, np.ones((40, 8)))] * 2)
    expected = interpolate(tracks, np.array([[0.01], [0.03]]), 0.0).expected(tracks.strain)
    assert expected.interpolation_error[0].max() == 0.0
    assert expected.interpolation_error[1].min() > 1.0


def test_interpolation_across_the_wrap_of_yaw() -> None:
    scene = Scene("turn", (Axis("x", 0.0, SIDE), Axis("yaw", -np.pi, np.pi)), (Phalanx("index", (0.0, 0.0)),))
    x = np.arange(0.0, SIDE, 0.0005)
    yaws = (np.pi - 0.05, -np.pi + 0.05)
    lines = [(np.column_stack([x, np.full_like(x, yaw)]), np.full((len(x), 8), yaw)) for yaw in yaws]
    tracks = joined(scene, *lines)
    expected = interpolate(tracks, np.array([[0.01, -np.pi + 1e-6]]), 0.002).expected(tracks.strain)
    assert expected.mean[0, 0, 0] == pytest.approx(0.0, abs=1e-3)
    assert expected.distance[0] == pytest.approx(0.05 * YAW_LEVER, abs=1e-6)


def test_places_are_interpolated_alike_among_few_and_many_others(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    wide = Scene("wide", (Axis("x", 0.0, 0.5), Axis("y", 0.0, 0.5)), (Phalanx("a", (0.0, 0.0)),))
    along = np.linspace(0.0, 0.05, 40)[:, None] * np.array([0.0, 1.0])
    starts = rng.uniform(0.0, 0.45, (60, 1, 2))
    tracks = joined(wide, *[(start + along, rng.standard_normal((40, 8))) for start in starts])
    places = rng.uniform(0.0, 0.5, (300, 2))
    whole = interpolate(tracks, places, 0.01).expected(tracks.strain)
    monkeypatch.setattr("tactile_localizer.core.scan.interpolation._PLACES_AT_ONCE", 20)
    parts = list(tiles(places))
    np.testing.assert_array_equal(np.sort(np.concatenate(parts)), np.arange(300))
    assert max(map(len, parts)) <= 20
    for part in parts:
        found = interpolate(tracks, places[part], 0.01).expected(tracks.strain)
        for mine, theirs in zip(found, whole, strict=True):
            np.testing.assert_allclose(mine, theirs[part], rtol=1e-12, atol=1e-15)


def test_the_further_apart_two_lines_are_the_less_probable_is_their_pair() -> None:
    """By 0.2 nats for each line between them: of a place midway between the fifth and the sixth of ten."""
    plane = Scene("plane", (Axis("x", 0.0, 0.03), Axis("y", 0.0, 0.03)), (Phalanx("index", (0.0, 0.0)),))
    tracks = Tracks.of(raster(plane, lambda states, _: states @ np.ones((2, 8)), 0.003, 0.0), plane)
    found = interpolate(tracks, np.array([[0.015, 0.0135]]), 0.003).log_prior[0]
    np.testing.assert_allclose(found - found[0], [0.0, -0.2, -0.2, -0.4, -0.4, -0.4], atol=1e-9)
