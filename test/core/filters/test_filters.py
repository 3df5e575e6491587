"""What the grid and the particle filter have in common."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.models import KalmanFilter, LinearModel, flat_update, step
from support.scans import scene

from tactile_localizer.core.filters.base import BayesFilter
from tactile_localizer.core.filters.grid import GridFilter
from tactile_localizer.core.filters.particle import ParticleFilter
from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.scene import Axis, Phalanx, Scene

Make = Callable[..., BayesFilter]
PLANE, TURNING = scene(), scene(3, full_turn=True)
LINE = Scene("line", (Axis("x", 0.0, 0.1, 0.0),), (Phalanx("a", (0.0,)),))
STRAIN = np.zeros(16)
MODEL = LinearModel(np.random.default_rng(0).standard_normal((16, 2)) * 50, 1.0)


def grid(of: Scene = PLANE, cells: float = 50.0) -> BayesFilter:
    return GridFilter(of, of.extent / cells)


def particles(of: Scene = PLANE, cells: float = 50.0) -> BayesFilter:
    return ParticleFilter(of, np.random.default_rng(0), 20_000 if cells == 200.0 else 2_000)


def particle(of: Scene = PLANE, _: float = 0.0) -> BayesFilter:
    """One alone."""
    return ParticleFilter(of, np.random.default_rng(0), 1)


both = pytest.mark.parametrize("make", [grid, particles])


@both
def test_it_agrees_with_the_kalman_filter_on_a_linear_scene(make: Make) -> None:
    motion_std = np.array([0.02, 0.03])
    axes = (Axis("x", -0.02, 0.08, motion_std[0]), Axis("y", -0.02, 0.08, motion_std[1]))
    made = make(Scene("wide", axes, tuple(Phalanx(name, (0.0, 0.0)) for name in "ab")), 200.0)
    tolerance = 0.02 if make is grid else 0.1
    start, spread = np.array([0.012, 0.018]), np.array([0.006, 0.006])
    made.seed(start, spread)
    kalman = KalmanFilter(start, np.diag(spread**2), MODEL)
    rng, truth = np.random.default_rng(4), np.array([0.010, 0.020])
    for _ in range(30):
        displacement, travel = np.array([0.00071, 0.00013]), 0.00072
        truth = truth + displacement
        strain = MODEL.gain @ truth + rng.standard_normal(16)
        kalman.predict(displacement, motion_std**2 * travel)
        belief, log_marginal = step(made, MODEL, strain, displacement, travel)
        assert log_marginal == pytest.approx(kalman.update(strain), abs=tolerance)
        std = np.sqrt(np.diag(kalman.covariance))
        assert np.abs((belief.mean - kalman.mean) / std).max() < tolerance
        np.testing.assert_allclose(np.sqrt(np.diag(belief.covariance)), std, rtol=tolerance)


@both
def test_when_no_state_explains_the_strain_nothing_is_learned(make: Make) -> None:
    made = make()
    made.seed(np.array([0.02, 0.02]), np.array([0.003, 0.003]))
    before = flat_update(made)
    after = flat_update(made, -math.inf)
    np.testing.assert_allclose(after.mean, before.mean, atol=1e-12)
    np.testing.assert_allclose(after.covariance, before.covariance, atol=1e-15)


@both
def test_what_leaves_the_scene_is_lost_and_its_fraction_returned(make: Make) -> None:
    made = make(scene(1))
    assert made.predict(np.array([0.02]), 0.0).left == pytest.approx(0.4, abs=1e-3)
    belief = made.update(np.zeros(len(made.weights())))
    assert belief.mean[0] == pytest.approx(0.035, abs=1e-3)


@both
@pytest.mark.parametrize("distance", [0.06, 1.0, 1e6, 1e30, 1e300])
def test_a_belief_that_has_left_the_scene_begins_anew_wherever_it_went(make: Make, distance: float) -> None:
    made = make()
    assert made.predict(np.array([distance, 0.0]), distance).left == 1.0
    belief = flat_update(made)
    np.testing.assert_allclose(belief.mean, 0.025, atol=0.001)
    assert belief.covariance[0, 0] == pytest.approx(0.05**2 / 12, rel=0.1)


@both
def test_yaw_wraps_around_and_keeps_its_spread(make: Make) -> None:
    """A Gaussian about pi lies on both ends of the axis, and remains one wherever the hand turns."""
    made = make(TURNING, 20.0)
    made.seed(np.array([0.025, 0.025, math.pi]), np.array([0.1, 0.1, 0.3]))
    before = flat_update(made)
    assert abs(wrap_angle(before.mean[2] - math.pi)) < 0.03
    assert math.sqrt(before.covariance[2, 2]) == pytest.approx(0.3, rel=0.1)
    for _ in range(100):
        made.predict(np.array([0.0, 0.0, 0.123]), 0.0)
    belief = flat_update(made)
    assert wrap_angle(belief.mean[2] - before.mean[2] - 12.3) == pytest.approx(0.0, abs=0.03)
    assert belief.covariance[2, 2] == pytest.approx(before.covariance[2, 2], rel=0.1)


@pytest.mark.parametrize("make", [grid, particles, particle])
@given(seed=st.integers(0, 2**32 - 1), size=st.sampled_from([1e-12, 1e-3, 1.0, 1e3]))
def test_whatever_happens_the_belief_sums_to_one(make: Make, seed: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    model = LinearModel(rng.standard_normal((16, 2)) * 50, size)
    made = make(PLANE, 25.0)
    for _ in range(5):
        displacement = 0.01 * rng.standard_normal(2)
        injected = 0.1 * float(rng.random())
        travel = float(np.hypot(*displacement))
        belief, _ = step(made, model, rng.standard_normal(16), displacement, travel, injected)
        states, weights = made.hypotheses()
        assert weights.sum() == pytest.approx(1.0, abs=1e-12)
        assert (weights >= 0).all()
        assert np.isfinite(states).all()
        assert np.linalg.eigvalsh(belief.covariance).min() >= -1e-20


@both
def test_resampled_states_come_from_what_they_copy(make: Make) -> None:
    made = make(LINE, 100.0)
    before = made.predict(np.zeros(1), 0.0).states.copy()
    made.update(-0.5 * ((before[:, 0] - 0.05) / 0.005) ** 2)
    after = made.predict(np.array([0.01]), 0.01)
    known = after.weights > 1e-9
    moved = (after.states - before[after.ancestors])[known & (after.continued > 0.0)]
    np.testing.assert_allclose(moved, 0.01, atol=0.008)  # particles are jittered


@both
def test_a_state_continues_its_ancestor_but_for_what_was_injected(make: Make) -> None:
    made = make(LINE, 1_000.0)
    assert not made.predict(np.zeros(1), 0.0).continued.any(), "nothing was there before"
    made.seed(np.array([0.02]), np.array([0.003]))
    assert not made.predict(np.zeros(1), 0.0).continued.any(), "a seed has no ancestors"
    prediction = made.predict(np.zeros(1), 0.0, 0.4)
    assert prediction.weights @ prediction.continued == pytest.approx(0.6, abs=0.05)


@both
def test_hypotheses_handed_out_do_not_change_afterwards(make: Make) -> None:
    made = make()
    states, weights = made.hypotheses()
    before = states.copy(), weights.copy()
    step(made, MODEL, STRAIN, np.array([0.01, 0.0]), 0.01, 0.5)
    np.testing.assert_array_equal(states, before[0])
    np.testing.assert_array_equal(weights, before[1])


@both
def test_what_is_injected_is_uniform(make: Make) -> None:
    made = make(LINE, 200.0)
    made.seed(np.array([0.02]), np.array([0.003]))
    prediction = made.predict(np.zeros(1), 0.0, 0.4)
    for place in (0.04, 0.06, 0.08):
        near = np.abs(prediction.states[:, 0] - place) < 0.01
        assert prediction.weights[near].sum() == pytest.approx(0.4 * 0.02 / LINE.extent[0], abs=0.03)
