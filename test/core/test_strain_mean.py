"""The mean of the strains since the last measurement update, at their mean position."""

import numpy as np
from support.scans import scene

from tactile_localizer.core.geometry.motion import MotionModel
from tactile_localizer.core.strain_mean import StrainMean

BOTH, ONE = np.ones(2, dtype=bool), np.array([True, False])
SLOPE = np.array([[3.0, -1.0, 0.5, 2.0], [0.2, 4.0, -2.0, 1.0]])


def strain_mean(dimension: int = 2, full_turn: bool = False) -> StrainMean:
    return StrainMean(MotionModel(scene(dimension, full_turn=full_turn)))


def test_on_a_linear_map_it_is_the_strain_at_the_mean_position() -> None:
    """Whatever the way and the spacing: nothing is gained or lost between updates."""
    mean, rng, at = strain_mean(), np.random.default_rng(0), np.array([3.0, -2.0])
    mean.add(at, at @ SLOPE, BOTH)
    strain, displacement = mean.take()
    np.testing.assert_array_equal(displacement, 0.0)
    mean_at = at
    for count in (1, 4, 9):
        for _ in range(count):
            at = at + 0.001 * rng.standard_normal(2)
            mean.add(at, at @ SLOPE, BOTH)
        strain, displacement = mean.take()
        mean_at = mean_at + displacement
        np.testing.assert_allclose(strain, mean_at @ SLOPE)
        np.testing.assert_allclose(mean.pending, at - mean_at, atol=1e-12)


def test_where_other_phalanges_are_present_it_begins_anew() -> None:
    mean = strain_mean()
    mean.add(np.zeros(2), np.zeros(4), BOTH)
    mean.take()
    for x, present in ((0.0001, BOTH), (0.0002, ONE), (0.0004, ONE)):
        mean.add(np.array([x, 0.0]), np.full(4, x), present)
    strain, displacement = mean.take()
    np.testing.assert_allclose(strain, 0.0003)
    np.testing.assert_allclose(displacement, [0.0003, 0.0])


def test_a_long_way_is_not_averaged() -> None:
    """The map's points are means over 0.5 mm: of 3 mm, the last 0.6 mm are compared with them."""
    mean = strain_mean()
    for n in range(16):
        mean.add(np.array([2e-4 * n, 0.0]), np.full(4, float(n)), BOTH)
    strain, displacement = mean.take()
    np.testing.assert_allclose(strain, np.mean([12, 13, 14, 15]))
    np.testing.assert_allclose(displacement, [2e-4 * 13.5, 0.0])


def test_over_a_full_turn_the_mean_is_on_the_short_way() -> None:
    mean = strain_mean(3, full_turn=True)
    for yaw in (np.pi - 0.003, np.pi - 0.003, -np.pi + 0.003):
        mean.add(np.array([0.0, 0.0, yaw]), np.zeros(4), BOTH)
    _, displacement = mean.take()
    np.testing.assert_allclose(displacement, [0.0, 0.0, 0.002], atol=1e-12)
