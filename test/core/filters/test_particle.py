"""The particle filter weights, resamples and injects; with many particles it agrees with exact recursions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from support.models import FlatModel, KalmanFilter, LinearModel, weight
from support.scans import scene

from tactile_localizer.core.filters.grid import GridFilter
from tactile_localizer.core.filters.particle import ParticleFilter
from tactile_localizer.core.filters.resampling import RESAMPLERS
from tactile_localizer.errors import ParameterError
from tactile_localizer.scene import Axis, Phalanx, Scene

STRAIN = np.zeros(16)


def linear(dimension=2, std=1.0, seed=0):
    return LinearModel(np.random.default_rng(seed).standard_normal((16, dimension)) * 50, std)


def sweep(model, steps, seed=5):
    """Displacements and strains of a palm that slides from (10, 20) mm."""
    rng = np.random.default_rng(seed)
    truth = np.array([0.010, 0.020])
    for _ in range(steps):
        step = np.array([0.0005, 0.0001])
        truth = truth + step + rng.standard_normal(2) * [0.003, 0.001] * math.sqrt(0.00051)
        yield step, 0.00051, model.gain @ truth + model.std * rng.standard_normal(16)


def test_a_reset_covers_the_scene_evenly_even_with_few_particles():
    states, weights = ParticleFilter(scene(), np.random.default_rng(0), 75).hypotheses()
    for axis in range(2):
        assert np.bincount((states[:, axis] / 0.05 * 75).astype(int), minlength=75).tolist() == [1] * 75
    assert weights == pytest.approx(1 / 75)


def test_a_measurement_update_is_bayes_rule():
    model = linear()
    particles = ParticleFilter(scene(), np.random.default_rng(0), 500)
    states, _ = particles.hypotheses()
    strain = model.gain @ [0.02, 0.03]
    log_marginal = weight(particles, model, strain)
    likelihood = np.exp(model.log_likelihood(states, strain))
    np.testing.assert_allclose(particles.hypotheses()[1], likelihood / likelihood.sum(), rtol=1e-9)
    assert log_marginal == pytest.approx(math.log(likelihood.mean()))
    mean = likelihood @ states / likelihood.sum()
    np.testing.assert_allclose(particles.belief().mean, mean)


@pytest.mark.parametrize("resampling", RESAMPLERS)
def test_it_agrees_with_the_kalman_filter_on_a_linear_scene(resampling):
    wide = Scene(
        "wide", (Axis("x", -1, 1, 0.003), Axis("y", -1, 1, 0.001)), tuple(Phalanx(n, (0, 0)) for n in "ab")
    )
    model = linear()
    start, spread = np.array([0.012, 0.018]), np.array([0.004, 0.004])
    kalman = KalmanFilter(start, np.diag(spread**2), model)
    particles = ParticleFilter(wide, np.random.default_rng(1), 20_000, resampling)
    particles.seed(start, spread)
    variance = np.array([0.003, 0.001]) ** 2
    for step, travel, strain in sweep(model, 25):
        kalman.predict(step, variance * travel)
        particles.predict(step, travel)
        assert weight(particles, model, strain) == pytest.approx(kalman.update(strain), abs=0.1)
        std = np.sqrt(np.diag(kalman.covariance))
        belief = particles.belief()
        assert np.abs((belief.mean - kalman.mean) / std).max() < 0.1
        np.testing.assert_allclose(np.sqrt(np.diag(belief.covariance)), std, rtol=0.1)


def test_it_comes_closer_to_the_grid_filter_the_more_particles_it_has():
    model = linear(std=2.0)
    grid = GridFilter(scene(), np.array([0.0002, 0.0002]))
    steps = list(sweep(model, 20))
    exact = []
    for step, travel, strain in steps:
        grid.predict(step, travel)
        weight(grid, model, strain)
        exact.append(grid.belief().mean)
    errors = []
    for count in (30, 300, 3000, 30_000):
        distances = []
        for seed in range(6 if count < 30_000 else 1):
            particles = ParticleFilter(scene(), np.random.default_rng(seed), count)
            for (step, travel, strain), mean in zip(steps, exact, strict=True):
                particles.predict(step, travel)
                weight(particles, model, strain)
                distances.append(np.linalg.norm(particles.belief().mean - mean))
        errors.append(np.sqrt(np.mean(np.square(distances))))
    assert errors == sorted(errors, reverse=True)
    assert errors[2] < 0.25 * errors[0]
    assert errors[3] < 1e-4


def test_a_belief_that_has_left_the_scene_begins_anew():
    particles = ParticleFilter(scene(), np.random.default_rng(0), 75)
    particles.predict(np.array([1e6, 0.0]), 1e6)
    weight(particles, FlatModel(), STRAIN)
    belief = particles.belief()
    assert np.isfinite(belief.mean).all()
    assert belief.effective_sample_size == pytest.approx(75)
    assert np.sqrt(np.diag(belief.covariance)) == pytest.approx(0.05 / math.sqrt(12), rel=0.2)


def test_when_no_state_explains_the_strain_nothing_is_learned():
    model = linear()
    particles = ParticleFilter(scene(), np.random.default_rng(0), 75, resample_below=0.01)
    weight(particles, model, model.gain @ [0.02, 0.03])
    before = particles.belief()
    weight(particles, FlatModel(-math.inf), STRAIN)
    np.testing.assert_allclose(particles.belief().mean, before.mean)
    np.testing.assert_allclose(particles.belief().covariance, before.covariance)


@pytest.mark.parametrize("count", [1, 2, 3, 75])
@given(seed=st.integers(0, 2**32 - 1))
def test_any_number_of_particles_keeps_weights_that_sum_to_one(count, seed):
    model = linear(std=0.01)
    particles = ParticleFilter(
        scene(), np.random.default_rng(seed), count, "systematic" if count % 2 else "multinomial"
    )
    for step, travel, strain in sweep(model, 5, seed):
        particles.predict(step, travel)
        weight(particles, model, strain)
        particles.inject(0.2)
        states, weights = particles.hypotheses()
        assert len(states) == count
        assert np.isfinite(states).all()
        assert weights.sum() == pytest.approx(1.0, abs=1e-12)


def test_constant_injection_replaces_every_particle_alike_when_all_weigh_the_same():
    """Resampled particles stand in order of their ancestors: replacing the first would cull one lineage."""
    replaced = np.zeros(20)
    for seed in range(300):
        particles = ParticleFilter(
            scene(), np.random.default_rng(seed), 20, resample_below=1.0, random_particles=5
        )
        particles.seed(np.array([0.025, 0.025]), np.array([1e-9, 1e-9]))
        weight(particles, FlatModel(), STRAIN)
        replaced += np.abs(particles.hypotheses()[0] - 0.025).max(axis=1) > 1e-6
    assert replaced.sum() == 5 * 300
    assert stats.chisquare(replaced).pvalue > 1e-3


def test_constant_injection_happens_at_each_update_and_counts_once_weighted():
    model = linear(std=0.1)
    particles = ParticleFilter(scene(), np.random.default_rng(0), 75, random_particles=10)
    particles.seed(np.array([0.02, 0.03]), np.array([1e-4, 1e-4]))
    for _ in range(5):
        weight(particles, model, model.gain @ [0.02, 0.03])
        states, weights = particles.hypotheses()
        far = np.linalg.norm(states - [0.02, 0.03], axis=1) > 0.002
        assert 5 <= far.sum() <= 10
        assert weights[far].sum() < 1e-3
        assert np.linalg.norm(particles.belief().mean - [0.02, 0.03]) < 2e-4


@pytest.mark.parametrize("fraction", [0.0, 0.1, 0.5, 1.0])
def test_injection_spreads_its_fraction_uniformly(fraction):
    spread = []
    for seed in range(40):
        particles = ParticleFilter(scene(), np.random.default_rng(seed), 100)
        particles.seed(np.array([0.025, 0.025]), np.array([1e-5, 1e-5]))
        particles.inject(fraction)
        states, weights = particles.hypotheses()
        spread.append(weights[np.abs(states - 0.025).max(axis=1) > 1e-3].sum())
    assert np.mean(spread) == pytest.approx(fraction, abs=0.03)


def test_a_wide_belief_has_more_particles_than_a_converged_one():
    model = linear(std=0.05)
    particles = ParticleFilter(scene(), np.random.default_rng(0), 75, max_particles=1500)
    assert particles.belief().hypotheses == 1500
    for _ in range(3):
        weight(particles, model, model.gain @ [0.02, 0.03])
        particles.predict(np.zeros(2), 0.0)
    assert particles.belief().hypotheses == 75
    particles.inject(1.0)
    particles.predict(np.zeros(2), 0.0)
    weight(particles, FlatModel(), STRAIN)
    particles.predict(np.array([0.06, 0.0]), 0.06)
    assert particles.belief().hypotheses == 1500


def test_copies_of_one_ancestor_stay_within_the_bounds():
    particles = ParticleFilter(scene(), np.random.default_rng(0), 1000, resample_below=1.0)
    for _ in range(20):
        assert particles.predict(np.zeros(2), 0.0) == 0.0
        weight(particles, FlatModel(), STRAIN)
    states, weights = particles.hypotheses()
    for axis in range(2):
        near_a_bound = np.abs(states[:, axis] - 0.025) > 0.022
        assert weights[near_a_bound].sum() == pytest.approx(0.12, abs=0.03)


def test_yaw_wraps_around_as_the_belief_moves_on():
    turning = scene(3, full_turn=True)
    particles = ParticleFilter(turning, np.random.default_rng(0), 500)
    particles.seed(np.array([0.025, 0.025, 3.0]), np.array([1e-4, 1e-4, 0.05]))
    for _ in range(10):
        particles.predict(np.array([0.0, 0.0, 0.1]), 0.0)
        weight(particles, FlatModel(), STRAIN)
    belief = particles.belief()
    assert belief.mean[2] == pytest.approx(4.0 - 2 * math.pi, abs=0.02)
    assert math.sqrt(belief.covariance[2, 2]) == pytest.approx(0.05, rel=0.2)
    assert np.abs(particles.hypotheses()[0][:, 2]).max() <= math.pi


def test_as_many_random_particles_as_there_are_particles_are_refused():
    with pytest.raises(ParameterError, match="random_particles: expected 0 to 74, got 75"):
        ParticleFilter(scene(), np.random.default_rng(0), 75, random_particles=75)
