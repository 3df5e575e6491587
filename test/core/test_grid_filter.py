"""The grid filter is the exact Bayes recursion: motion, diffusion and weighing keep the moments."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.models import FlatModel, KalmanFilter, LinearModel
from support.scans import scene

from tactile_localizer.core.credit import NO_CREDIT, Credit
from tactile_localizer.core.grid_filter import GridFilter
from tactile_localizer.errors import ParameterError
from tactile_localizer.scene import Axis, Phalanx, Region, Scene

PRESENT = np.ones(2, bool)
NOWHERE = NO_CREDIT
STRAIN = np.zeros(16)


def line(motion_std=0.0, half=0.5):
    return Scene("line", (Axis("x", -half, half, motion_std),), (Phalanx("a", (0.0,)), Phalanx("b", (0.0,))))


def test_a_reset_is_uniform():
    belief = GridFilter(scene(), FlatModel(), np.array([0.001, 0.001])).belief()
    np.testing.assert_allclose(belief.mean, 0.025)
    np.testing.assert_allclose(np.sqrt(np.diag(belief.covariance)), 0.05 / math.sqrt(12), rtol=1e-12)
    assert belief.hypotheses == 2500
    assert belief.effective_sample_size == pytest.approx(2500)


def test_cells_are_no_larger_than_asked_and_fill_the_scene():
    grid = GridFilter(scene(), FlatModel(), np.array([0.0007, 0.2]))
    states, weights = grid.hypotheses()
    assert len(states) == len(weights) == 72
    assert states[:, 0].min() == pytest.approx(0.05 / 144)
    assert states[:, 1] == pytest.approx(0.025)


def test_the_mean_follows_motion_far_below_a_cell_without_drift_or_smear():
    """A hundred thousand steps of a thousandth of a cell, to and fro, keep the spread of the first moment."""
    grid = GridFilter(line(), FlatModel(), np.array([0.01]))
    grid.seed(np.array([0.0]), np.array([0.05]))
    before = grid.belief()
    rng = np.random.default_rng(0)
    steps = 1e-5 * rng.standard_normal(100_000)
    steps += np.where(np.arange(100_000) % 20_000 < 10_000, 1e-5, -1e-5)
    for step in steps:
        grid.predict(np.array([step]), abs(step))
    after = grid.belief()
    assert after.mean[0] - before.mean[0] == pytest.approx(steps.sum(), abs=1e-9)
    assert after.covariance[0, 0] == pytest.approx(before.covariance[0, 0], rel=1e-9)


@pytest.mark.parametrize("step", [1e-5, 1e-4, 0.01, 0.04])
def test_the_variance_grows_with_the_travel_whatever_the_steps(step):
    """Small diffusion is saved up, large diffusion is one wide kernel: the sum is the same."""
    grid = GridFilter(line(motion_std=0.1), FlatModel(), np.array([0.01]))
    grid.seed(np.array([0.0]), np.array([0.03]))
    before = grid.belief().covariance[0, 0]
    for turn in range(round(0.4 / step)):
        grid.predict(np.array([step if turn % 2 else -step]), step)
    assert grid.belief().covariance[0, 0] - before == pytest.approx(0.1**2 * 0.4, rel=2e-3)


def test_it_agrees_with_the_kalman_filter_on_a_linear_scene():
    wide = Scene(
        "wide",
        (Axis("x", -0.05, 0.10, 0.02), Axis("y", -0.05, 0.10, 0.03)),
        (Phalanx("a", (0.0, 0.0)), Phalanx("b", (0.0, 0.0))),
    )
    model = LinearModel(np.random.default_rng(0).standard_normal((16, 2)) * 50, 1.0)
    start, spread = np.array([0.012, 0.018]), np.array([0.006, 0.006])
    kalman = KalmanFilter(start, np.diag(spread**2), model)
    grid = GridFilter(wide, model, np.array([0.0005, 0.0005]))
    grid.seed(start, spread)
    # The seed's spread within a cell is the belief's own, but no part of the recursion on cells.
    kalman.covariance = grid.belief().covariance - np.diag(np.full(2, 0.0005**2 / 12))
    rng, truth = np.random.default_rng(4), np.array([0.010, 0.020])
    for _ in range(40):
        step, travel = np.array([0.00071, 0.00013]), 0.00072
        truth = truth + step
        strain = model.gain @ truth + rng.standard_normal(16)
        kalman.predict(step, np.array([0.02, 0.03]) ** 2 * travel)
        grid.predict(step, travel)
        assert grid.update(strain, PRESENT, 1.0, NOWHERE)[0] == pytest.approx(kalman.update(strain), abs=0.02)
        belief, std = grid.belief(), np.sqrt(np.diag(kalman.covariance))
        assert np.abs((belief.mean - kalman.mean) / std).max() < 0.02
        np.testing.assert_allclose(np.sqrt(np.diag(belief.covariance)), std, rtol=0.02)


def test_a_tempered_step_counts_for_less_and_its_evidence_is_untempered():
    model = LinearModel(np.random.default_rng(0).standard_normal((16, 2)) * 50, 1.0)
    one, half = (GridFilter(scene(), model, np.array([0.001, 0.001])) for _ in range(2))
    assert (
        half.update(STRAIN, PRESENT, 0.5, NOWHERE).log_likelihood
        == one.update(STRAIN, PRESENT, 1.0, NOWHERE).log_likelihood
    )
    half.update(STRAIN, PRESENT, 0.5, NOWHERE)
    np.testing.assert_allclose(half.hypotheses()[1], one.hypotheses()[1], atol=1e-14)


def test_when_no_state_explains_the_strain_nothing_is_learned():
    grid = GridFilter(scene(), FlatModel(-math.inf), np.array([0.001, 0.001]))
    grid.seed(np.array([0.02, 0.02]), np.array([0.003, 0.003]))
    before = grid.belief()
    assert grid.update(STRAIN, PRESENT, 1.0, NOWHERE).log_likelihood == -math.inf
    np.testing.assert_allclose(grid.belief().mean, before.mean)
    np.testing.assert_allclose(grid.belief().covariance, before.covariance)


def test_off_the_feature_the_evidence_is_at_least_that_of_featureless_material():
    where = Region((0.04, -math.inf), (0.05, math.inf))
    grid = GridFilter(scene(phalanges=1, feature=where), FlatModel(-100.0), np.array([0.001, 0.001]))
    log_marginal, _ = grid.update(np.zeros(8), PRESENT[:1], 1.0, Credit(-10.0, -10.0))
    assert log_marginal == pytest.approx(-10.0 + math.log(0.8), abs=1e-9)


def test_what_leaves_the_scene_is_lost_and_the_rest_is_believed():
    grid = GridFilter(scene(1), FlatModel(), np.array([0.001]))
    grid.predict(np.array([0.02]), 0.0)
    states, weights = grid.hypotheses()
    assert weights.sum() == pytest.approx(1.0)
    assert weights[states[:, 0] < 0.02].sum() == 0.0
    assert grid.belief().mean[0] == pytest.approx(0.035)


@pytest.mark.parametrize("distance", [0.06, 1.0, 1e6, 1e30, 1e300])
def test_a_belief_that_has_left_the_scene_begins_anew_wherever_it_went(distance):
    grid = GridFilter(scene(), FlatModel(), np.array([0.001, 0.001]))
    grid.predict(np.array([distance, 0.0]), distance)
    grid.update(STRAIN, PRESENT, 1.0, NOWHERE)
    belief = grid.belief()
    np.testing.assert_allclose(belief.mean, 0.025, atol=0.001)
    assert belief.covariance[0, 0] == pytest.approx(0.05**2 / 12, rel=0.1)
    grid.predict(np.array([0.001, 0.0]), 0.001)
    assert np.isfinite(grid.belief().covariance).all()


def test_yaw_wraps_around_and_keeps_its_spread():
    grid = GridFilter(scene(3, full_turn=True), FlatModel(), np.array([0.025, 0.025, 0.02]))
    grid.seed(np.array([0.025, 0.025, 2.5]), np.array([0.1, 0.1, 0.1]))
    spread = grid.belief().covariance[2, 2]
    for _ in range(1000):
        grid.predict(np.array([0.0, 0.0, 0.0123]), 0.0)
    belief = grid.belief()
    expected = (2.5 + 12.3 + math.pi) % (2 * math.pi) - math.pi
    assert belief.mean[2] == pytest.approx(expected, abs=1e-6)
    assert belief.covariance[2, 2] == pytest.approx(spread, rel=1e-6)


def test_a_seed_on_the_far_side_of_the_turn_is_the_same_seed():
    """Yaw of pi is yaw of -pi: a Gaussian about it lies on both ends of the axis."""
    grid = GridFilter(scene(3, full_turn=True), FlatModel(), np.array([0.025, 0.025, 0.02]))
    grid.seed(np.array([0.025, 0.025, math.pi]), np.array([0.1, 0.1, 0.1]))
    belief = grid.belief()
    assert abs(belief.mean[2]) == pytest.approx(math.pi, abs=1e-6)
    assert math.sqrt(belief.covariance[2, 2]) == pytest.approx(0.1, rel=0.01)


@pytest.mark.parametrize("fraction", [0.0, 0.3, 1.0])
def test_recovery_spreads_the_share_that_it_is_told(fraction):
    grid = GridFilter(scene(), FlatModel(), np.array([0.001, 0.001]))
    grid.seed(np.array([0.02, 0.02]), np.array([0.0005, 0.0005]))
    grid.recover(fraction)
    states, weights = grid.hypotheses()
    far = np.abs(states - 0.02).max(axis=1) > 0.005
    assert weights.sum() == pytest.approx(1.0)
    assert weights[far].sum() == pytest.approx(fraction * far.mean(), abs=1e-9)


@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.sampled_from([1e-12, 1e-3, 1.0, 1e3]),
)
def test_whatever_happens_the_belief_sums_to_one(seed, size):
    rng = np.random.default_rng(seed)
    model = LinearModel(rng.standard_normal((16, 2)) * 50, size)
    grid = GridFilter(scene(), model, np.array([0.005, 0.004]))
    for _ in range(5):
        step = 0.01 * rng.standard_normal(2)
        grid.predict(step, float(np.hypot(*step)))
        grid.update(rng.standard_normal(16), PRESENT, float(rng.random()), NOWHERE)
        grid.recover(float(rng.random()) * 0.1)
        states, weights = grid.hypotheses()
        assert weights.sum() == pytest.approx(1.0, abs=1e-12)
        assert (weights >= 0).all()
        assert np.isfinite(states).all()


def test_hypotheses_handed_out_do_not_change_afterwards():
    grid = GridFilter(scene(), FlatModel(), np.array([0.005, 0.005]))
    grid.seed(np.array([0.02, 0.02]), np.array([0.005, 0.005]))
    _, weights = grid.hypotheses()
    before = weights.copy()
    grid.recover(0.5)
    grid.predict(np.array([0.01, 0.0]), 0.01)
    np.testing.assert_array_equal(weights, before)


def test_more_cells_than_memory_is_meant_for_are_refused():
    with pytest.raises(
        ParameterError, match=r"cells: expected at most 4000000, got 2.5e\+09; use larger cells"
    ):
        GridFilter(scene(), FlatModel(), np.array([1e-6, 1e-6]))


def test_a_belief_that_leaves_the_scene_whole_begins_anew():
    """By steps shorter than the scene, each of which is believed; nothing is left to normalise."""
    grid = GridFilter(line(), FlatModel(), np.array([0.01]))
    grid.seed(np.array([0.45]), np.array([0.001]))
    grid.predict(np.array([0.6]), 0.6)
    np.testing.assert_allclose(grid.hypotheses()[1], 0.01)


def test_the_density_over_a_uniform_one_is_zero_outside_and_one_where_nothing_is_known():
    grid = GridFilter(line(), FlatModel(), np.array([0.01]))
    density = [grid.relative_density(np.array([x])) for x in (-0.6, 0.0, 0.6)]
    assert density == pytest.approx([0.0, 1.0, 0.0])


def test_the_evidence_of_a_sequence_is_that_of_all_its_strains_at_once():
    """Without motion the sum over the strains is the log of the cells' mean of the product of powers."""
    rng = np.random.default_rng(0)
    model = LinearModel(rng.standard_normal((16, 2)) * 50, 1.0)
    grid = GridFilter(scene(), model, np.array([0.001, 0.001]))
    states, product = grid.hypotheses()[0], 0.0
    total = 0.0
    for share in (0.3, 1.0, 0.05):
        strain = rng.standard_normal(16)
        total += grid.update(strain, PRESENT, share, NOWHERE).log_evidence
        product = product + share * model.log_likelihood(states, strain, PRESENT)
    assert total == pytest.approx(math.log(np.mean(np.exp(product))))
