"""The constant by which the strains of a sweep differ from those of the scan."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.decision.sweep_offset import SweepOffset
from tactile_localizer.core.likelihood.evaluation import Expected

LAYOUT = ChannelLayout((2, 3))
PRIOR = np.array([4.0, 1.0, 2.0, 0.5, 0.0])
BOTH = np.ones(2, dtype=bool)


def seen(residual: np.ndarray, noise: float = 1.0, spread: float = 0.0) -> Expected:
    return Expected(np.asarray(residual, dtype=float), np.full(5, spread), np.full(2, noise))


def test_small_residuals_are_taken_in_by_an_exact_kalman_filter() -> None:
    """Below the tails the update is linear: the innovation's robust weight is one."""
    offset, rng = SweepOffset(LAYOUT, PRIOR), np.random.default_rng(0)
    mean, variance = np.zeros(5), PRIOR.copy()
    for _ in range(20):
        measured = 0.3 * rng.standard_normal(5)
        offset.update(seen(measured - offset.mean), BOTH, 1.0)
        gain = np.divide(variance, variance + 1.0)
        mean, variance = mean + gain * (measured - mean), variance * (1.0 - gain)
    np.testing.assert_allclose(offset.mean, mean)
    np.testing.assert_allclose(offset.variance, variance)


def test_an_offset_is_learned_to_the_noise_of_its_looks() -> None:
    truth, rng = np.array([2.0, -1.0, 1.5, 0.7, 0.0]), np.random.default_rng(1)
    offset = SweepOffset(LAYOUT, PRIOR)
    for _ in range(200):
        offset.update(seen(truth + rng.standard_normal(5) - offset.mean), BOTH, 1.0)
    assert (np.abs(offset.mean - truth)[:4] < 4.0 * np.sqrt(offset.variance[:4])).all()
    assert (offset.variance[:4] < 0.02).all()


def test_while_the_position_is_open_little_is_learned() -> None:
    certain, open_ = SweepOffset(LAYOUT, PRIOR), SweepOffset(LAYOUT, PRIOR)
    certain.update(seen(np.ones(5)), BOTH, 1.0)
    open_.update(seen(np.ones(5), spread=50.0), BOTH, 1.0)
    assert (np.abs(open_.mean[:4]) < 0.2 * np.abs(certain.mean[:4])).all()


def test_a_dependent_measurement_counts_for_its_share() -> None:
    full, tenth = SweepOffset(LAYOUT, PRIOR), SweepOffset(LAYOUT, PRIOR)
    full.update(seen(np.full(5, 0.1)), BOTH, 1.0)
    for _ in range(10):
        tenth.update(seen(np.full(5, 0.1) - tenth.mean), BOTH, 0.1)
    np.testing.assert_allclose(tenth.variance, full.variance)
    np.testing.assert_allclose(tenth.mean, full.mean)


def test_an_absent_phalanx_learns_nothing() -> None:
    offset = SweepOffset(LAYOUT, PRIOR)
    offset.update(seen(np.ones(5)), np.array([True, False]), 1.0)
    assert (offset.mean[:2] > 0.0).all()
    assert (offset.mean[2:] == 0.0).all()
    np.testing.assert_array_equal(offset.variance[2:], PRIOR[2:])


def test_an_outlier_moves_the_offset_less_than_a_moderate_residual_of_its_size_would() -> None:
    offset = SweepOffset(LAYOUT, PRIOR)
    offset.update(seen(np.full(5, 1e6)), BOTH, 1.0)
    assert np.abs(offset.mean).max() < 10.0


def test_without_variance_there_is_nothing_to_learn() -> None:
    assert not SweepOffset(LAYOUT, np.zeros(5)).is_learned
    assert SweepOffset(LAYOUT, PRIOR).is_learned


def test_a_new_sweep_forgets() -> None:
    offset = SweepOffset(LAYOUT, PRIOR)
    offset.update(seen(np.ones(5)), BOTH, 1.0)
    offset.reset()
    np.testing.assert_array_equal(offset.mean, 0.0)
    np.testing.assert_array_equal(offset.variance, PRIOR)
    np.testing.assert_allclose(offset.phalanx_variance(), [2.5, 2.5 / 3])


@given(
    st.lists(
        st.tuples(st.floats(-1e9, 1e9), st.floats(0.01, 1e6), st.floats(0.0, 1e6), st.floats(0.0, 1.0)),
        max_size=30,
    )
)
def test_the_variance_never_grows_and_never_becomes_negative(looks) -> None:
    offset = SweepOffset(LAYOUT, PRIOR)
    for residual, noise, spread, exponent in looks:
        before = offset.variance
        offset.update(seen(np.full(5, residual), noise, spread), BOTH, exponent)
        assert (offset.variance <= before).all()
        assert (offset.variance >= 0.0).all()
        assert np.isfinite(offset.mean).all()
