"""The grid filter is the exact Bayes recursion: prediction and measurement update keep the moments."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage
from support.models import FlatModel, KalmanFilter, LinearModel, weight
from support.scans import scene

from tactile_localizer.core.filters.grid import GridFilter
from tactile_localizer.errors import ParameterError
from tactile_localizer.scene import Axis, Phalanx, Scene

STRAIN = np.zeros(16)


def line(motion_std=0.0, half=0.5):
    return Scene("line", (Axis("x", -half, half, motion_std),), (Phalanx("a", (0.0,)), Phalanx("b", (0.0,))))


def test_a_reset_is_uniform():
    belief = GridFilter(scene(), np.array([0.001, 0.001])).belief()
    np.testing.assert_allclose(belief.mean, 0.025)
    np.testing.assert_allclose(np.sqrt(np.diag(belief.covariance)), 0.05 / math.sqrt(12), rtol=1e-12)
    assert belief.hypotheses == 2500
    assert belief.effective_sample_size == pytest.approx(2500)


def test_cells_are_no_larger_than_asked_and_fill_the_scene():
    grid = GridFilter(scene(), np.array([0.0007, 0.2]))
    states, weights = grid.hypotheses()
    assert len(states) == len(weights) == 72
    assert states[:, 0].min() == pytest.approx(0.05 / 144)
    assert states[:, 1] == pytest.approx(0.025)


def test_the_mean_follows_motion_far_below_a_cell_without_drift_or_smear():
    """A hundred thousand steps of a thousandth of a cell, to and fro, keep the spread of the first moment."""
    grid = GridFilter(line(), np.array([0.01]))
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
    grid = GridFilter(line(motion_std=0.1), np.array([0.01]))
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
    grid = GridFilter(wide, np.array([0.0005, 0.0005]))
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
        assert weight(grid, model, strain) == pytest.approx(kalman.update(strain), abs=0.02)
        belief, std = grid.belief(), np.sqrt(np.diag(kalman.covariance))
        assert np.abs((belief.mean - kalman.mean) / std).max() < 0.02
        np.testing.assert_allclose(np.sqrt(np.diag(belief.covariance)), std, rtol=0.02)


def test_it_is_the_bayes_recursion_cell_by_cell():
    """Against transition and likelihood matrices written out, where the belief moves by whole cells."""
    scene = line(motion_std=0.2)
    cells, count = np.linspace(-0.495, 0.495, 100), 100
    grid = GridFilter(scene, np.array([0.01]))
    brute, rng = np.full(count, 1.0 / count), np.random.default_rng(3)
    for _ in range(12):
        grid.predict(np.array([0.02]), 0.02)
        steps = cells[:, None] - cells[None, :] - 0.02
        transition = np.exp(-0.5 * steps**2 / (0.2**2 * 0.02))
        brute = (transition / (0.2 * math.sqrt(2 * math.pi * 0.02)) * 0.01) @ brute
        log_likelihood = -0.5 * ((cells - rng.normal(0.1, 0.1)) / 0.15) ** 2
        brute = brute * np.exp(log_likelihood)
        brute /= brute.sum()
        states, _ = grid.prior()
        alive = np.rint((states[:, 0] + 0.495) / 0.01).astype(int)
        grid.update(log_likelihood[alive])
    states, weights = grid.hypotheses()
    found = np.zeros(count)
    found[np.rint((states[:, 0] + 0.495) / 0.01).astype(int)] = weights
    assert 0.5 * np.abs(found - brute).sum() < 1e-3


def test_an_exponent_counts_as_that_many_measurements():
    model = LinearModel(np.random.default_rng(0).standard_normal((16, 2)) * 50, 1.0)
    one, half = (GridFilter(scene(), np.array([0.001, 0.001])) for _ in range(2))
    weight(one, model, STRAIN)
    for _ in range(2):
        weight(half, model, STRAIN, 0.5)
    np.testing.assert_allclose(half.belief().mean, one.belief().mean, atol=1e-9)
    np.testing.assert_allclose(half.belief().covariance, one.belief().covariance, atol=1e-12)


def test_when_no_state_explains_the_strain_nothing_is_learned():
    grid = GridFilter(scene(), np.array([0.001, 0.001]))
    grid.seed(np.array([0.02, 0.02]), np.array([0.003, 0.003]))
    before = grid.belief()
    weight(grid, FlatModel(-math.inf), STRAIN)
    np.testing.assert_allclose(grid.belief().mean, before.mean)
    np.testing.assert_allclose(grid.belief().covariance, before.covariance)


def test_what_leaves_the_scene_is_lost_and_its_share_returned():
    grid = GridFilter(scene(1), np.array([0.001]))
    assert grid.predict(np.array([0.02]), 0.0) == pytest.approx(0.4)
    states, weights = grid.hypotheses()
    assert weights.sum() == pytest.approx(1.0)
    assert weights[states[:, 0] < 0.02].sum() == 0.0
    assert grid.belief().mean[0] == pytest.approx(0.035)


@pytest.mark.parametrize("distance", [0.06, 1.0, 1e6, 1e30, 1e300])
def test_a_belief_that_has_left_the_scene_begins_anew_wherever_it_went(distance):
    grid = GridFilter(scene(), np.array([0.001, 0.001]))
    grid.predict(np.array([distance, 0.0]), distance)
    weight(grid, FlatModel(), STRAIN)
    belief = grid.belief()
    np.testing.assert_allclose(belief.mean, 0.025, atol=0.001)
    assert belief.covariance[0, 0] == pytest.approx(0.05**2 / 12, rel=0.1)
    grid.predict(np.array([0.001, 0.0]), 0.001)
    assert np.isfinite(grid.belief().covariance).all()


def test_yaw_wraps_around_and_keeps_its_spread():
    grid = GridFilter(scene(3, full_turn=True), np.array([0.025, 0.025, 0.02]))
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
    grid = GridFilter(scene(3, full_turn=True), np.array([0.025, 0.025, 0.02]))
    grid.seed(np.array([0.025, 0.025, math.pi]), np.array([0.1, 0.1, 0.1]))
    belief = grid.belief()
    assert abs(belief.mean[2]) == pytest.approx(math.pi, abs=1e-6)
    assert math.sqrt(belief.covariance[2, 2]) == pytest.approx(0.1, rel=0.01)


@pytest.mark.parametrize("fraction", [0.0, 0.3, 1.0])
def test_injection_spreads_its_fraction_uniformly(fraction):
    grid = GridFilter(scene(), np.array([0.001, 0.001]))
    grid.seed(np.array([0.02, 0.02]), np.array([0.0005, 0.0005]))
    grid.inject(fraction)
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
    grid = GridFilter(scene(), np.array([0.005, 0.004]))
    for _ in range(5):
        step = 0.01 * rng.standard_normal(2)
        grid.predict(step, float(np.hypot(*step)))
        weight(grid, model, rng.standard_normal(16), float(rng.random()))
        grid.inject(float(rng.random()) * 0.1)
        states, weights = grid.hypotheses()
        assert weights.sum() == pytest.approx(1.0, abs=1e-12)
        assert (weights >= 0).all()
        assert np.isfinite(states).all()


def test_hypotheses_handed_out_do_not_change_afterwards():
    grid = GridFilter(scene(), np.array([0.005, 0.005]))
    grid.seed(np.array([0.02, 0.02]), np.array([0.005, 0.005]))
    _, weights = grid.hypotheses()
    before = weights.copy()
    grid.inject(0.5)
    grid.predict(np.array([0.01, 0.0]), 0.01)
    np.testing.assert_array_equal(weights, before)


def test_more_cells_than_memory_is_meant_for_are_refused():
    with pytest.raises(
        ParameterError, match=r"cells: expected at most 4000000, got 2.5e\+09; use larger cells"
    ):
        GridFilter(scene(), np.array([1e-6, 1e-6]))


def test_a_belief_that_leaves_the_scene_whole_begins_anew():
    """By steps shorter than the scene, each of which is possible; nothing is left to normalise."""
    grid = GridFilter(line(), np.array([0.01]))
    grid.seed(np.array([0.45]), np.array([0.001]))
    grid.predict(np.array([0.6]), 0.6)
    np.testing.assert_allclose(grid.hypotheses()[1], 0.01)


@pytest.mark.parametrize("axis", ["x", "yaw"])
@pytest.mark.parametrize("variance", [0.1, 0.6, 2.0, 900.0])
def test_diffusion_is_a_convolution_with_a_gaussian(axis: str, variance: float) -> None:
    turns = axis == "yaw"
    bounds = (-math.pi, math.pi) if turns else (0.0, 0.04)
    motion_std = 1e-3
    where = Axis(axis, *bounds, motion_std)
    grid = GridFilter(
        Scene("line", (where,), (Phalanx("index", (0.0,)),)), np.array([(bounds[1] - bounds[0]) / 40.0])
    )
    cell = (bounds[1] - bounds[0]) / 40.0
    grid.seed(np.array([bounds[0] + 5.5 * cell]), np.array([1e-9]))
    before = grid._belief.copy()
    grid.predict(np.zeros(1), variance * (cell / motion_std) ** 2)
    mode = "wrap" if turns else "constant"
    if variance <= 0.6:
        kernel = [0.5 * variance, 1.0 - variance, 0.5 * variance]
        expected = ndimage.correlate1d(before, kernel, mode=mode)
    else:
        expected = ndimage.gaussian_filter1d(before, math.sqrt(variance), mode=mode)
    assert grid._belief == pytest.approx(expected / expected.sum(), abs=1e-12)
