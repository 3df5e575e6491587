"""Sweeps end at reversals and rests, not at steps sideways."""

import itertools

import numpy as np

from tactile_localizer.scene import Axis
from tactile_localizer.streams.sweep_detector import NO_SWEEP, SweepDetector

AXES = (Axis("x", 0.0, 0.1), Axis("y", 0.0, 0.1))
RATE = 100


def path(*points: tuple[float, float], speed: float = 0.01) -> np.ndarray:
    """Positions at RATE along straight lines through the points."""
    legs = [np.array([points[0]])]
    for a, b in itertools.pairwise(points):
        steps = max(round(np.hypot(b[0] - a[0], b[1] - a[1]) / speed * RATE), 1)
        share = np.arange(1, steps + 1)[:, None] / steps
        legs.append(np.asarray(a) + share * (np.asarray(b) - np.asarray(a)))
    return np.concatenate(legs)


def numbers(detector: SweepDetector, positions: np.ndarray, start_s: float = 0.0) -> np.ndarray:
    stamps = [round((start_s + index / RATE) * 1e9) for index in range(len(positions))]
    return np.array([detector.update(t, p) for t, p in zip(stamps, positions, strict=True)])


def raster(lines: int = 4) -> np.ndarray:
    points = []
    for line in range(lines):
        ends = (0.0, 0.05) if line % 2 == 0 else (0.05, 0.0)
        points += [(end, 0.0025 * line) for end in ends]
    return path(*points)


def test_each_line_of_a_raster_is_a_sweep():
    positions = raster(4)
    found = numbers(SweepDetector(AXES), positions)
    assert set(found) == {NO_SWEEP, 1, 2, 3, 4}
    middle = np.abs(positions[:, 0] - 0.025) < 0.01
    line = np.round(positions[:, 1] / 0.0025).astype(int) + 1
    np.testing.assert_array_equal(found[middle], line[middle])


def test_only_a_reversal_distance_is_assigned_to_the_wrong_sweep():
    positions = raster(2)
    found = numbers(SweepDetector(AXES, reversal_m=0.002), positions)
    line = np.round(positions[:, 1] / 0.0025).astype(int) + 1
    wrong = (found != line) & (positions[:, 1] % 0.0025 == 0)
    assert wrong.sum() <= 2 * (0.002 / 0.01 * RATE + 2)


def test_one_way_ignores_returns():
    there_and_back = path((0, 0), (0.05, 0), (0, 0), (0.05, 0), (0, 0))
    found = numbers(SweepDetector(AXES, one_way=True), there_and_back)
    assert found.max() == 2
    going_back = np.concatenate([[False], np.diff(there_and_back[:, 0]) < 0])
    assert np.mean(found[going_back] == NO_SWEEP) > 0.95
    assert np.mean(found[~going_back] > 0) > 0.95


def test_jitter_smaller_than_a_reversal_does_not_end_a_sweep():
    positions = path((0, 0), (0.05, 0))
    positions = positions + np.random.default_rng(0).normal(0, 0.0003, positions.shape)
    assert set(numbers(SweepDetector(AXES), positions)) == {NO_SWEEP, 1}


def test_rest_ends_a_sweep():
    still = np.repeat([[0.02, 0.0]], 5 * RATE, axis=0)
    positions = np.concatenate([path((0, 0), (0.02, 0)), still, path((0.02, 0), (0.04, 0))])
    found = numbers(SweepDetector(AXES, rest_s=2.0), positions)
    assert found[100] == 1
    assert found[200 + 4 * RATE] == NO_SWEEP
    assert found[-1] == 2


def test_a_hand_at_rest_that_creeps_begins_no_sweep():
    """By less than a reversal in the time of a rest: also over many of them."""
    assert set(numbers(SweepDetector(AXES), path((0, 0), (0.01, 0), speed=0.0008))) == {NO_SWEEP}
    assert numbers(SweepDetector(AXES), path((0, 0), (0.01, 0), speed=0.0012))[-1] == 1


def test_sweeps_of_a_scene_with_yaw_alone():
    detector = SweepDetector((Axis("yaw", -1.0, 1.0),), reversal_m=0.05)
    turn = np.concatenate([np.linspace(0, 1, 100), np.linspace(1, 0, 100)])[:, None]
    assert numbers(detector, turn).max() == 2


def test_a_way_to_the_side_is_another_sweep():
    positions = path((0.0, 0.0), (0.05, 0.0), (0.05, 0.03), speed=0.004)
    found = numbers(SweepDetector(AXES), positions)
    assert set(found[positions[:, 1] == 0.0]) == {NO_SWEEP, 1}
    assert set(found[positions[:, 1] > 0.02]) == {2}


def test_samples_together_are_in_the_sweeps_of_samples_one_by_one():
    rng = np.random.default_rng(0)
    for axes in (AXES, (Axis("x", 0.0, 0.1),), (*AXES, Axis("yaw", -1.0, 1.0))):
        for one_way in (False, True):
            positions = np.cumsum(rng.normal(0.0, 5e-4, (500, len(axes))), axis=0)
            positions[rng.random(500) < 0.05] = np.nan
            stamps, parts = np.arange(500) * 10_000_000, np.arange(500) // 200
            one, other = (SweepDetector(axes, one_way=one_way) for _ in range(2))
            expected = [one.update(*each) for each in zip(stamps.tolist(), positions, parts, strict=True)]
            np.testing.assert_array_equal(other.update_all(stamps, positions, parts), expected)
            assert len(set(expected)) > 3
