"""The particle filter weights, resamples and injects; with many particles it agrees with exact recursions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from support.models import LinearModel, belief_of, step
from support.scans import scene

from tactile_localizer.core.filters.grid import GridFilter
from tactile_localizer.core.filters.particle import ParticleFilter
from tactile_localizer.errors import ParameterError


def linear(dimension=2, std=1.0, seed=0):
    return LinearModel(np.random.default_rng(seed).standard_normal((16, dimension)) * 50, std)


def sweep(model, steps, seed=5):
    """Displacements and strains of a palm that slides from (10, 20) mm."""
    rng = np.random.default_rng(seed)
    truth = np.array([0.010, 0.020])
    for _ in range(steps):
        displacement = np.array([0.0005, 0.0001])
        truth = truth + displacement + rng.standard_normal(2) * [0.003, 0.001] * math.sqrt(0.00051)
        yield displacement, 0.00051, model.gain @ truth + model.std * rng.standard_normal(16)


def test_a_reset_covers_the_scene_evenly_even_with_few_particles():
    states, weights = ParticleFilter(scene(), np.random.default_rng(0), 75).hypotheses()
    for axis in range(2):
        assert np.bincount((states[:, axis] / 0.05 * 75).astype(int), minlength=75).tolist() == [1] * 75
    assert weights == pytest.approx(1 / 75)


def test_it_comes_closer_to_the_grid_filter_the_more_particles_it_has():
    model = linear(std=2.0)
    grid = GridFilter(scene(), np.array([0.0002, 0.0002]))
    steps = list(sweep(model, 20))
    exact = []
    for displacement, travel, strain in steps:
        exact.append(step(grid, model, strain, displacement, travel)[0].mean)
    errors = []
    for count in (30, 300, 3000, 30_000):
        distances = []
        for seed in range(6 if count < 30_000 else 1):
            particles = ParticleFilter(scene(), np.random.default_rng(seed), count)
            for (displacement, travel, strain), mean in zip(steps, exact, strict=True):
                belief, _ = step(particles, model, strain, displacement, travel)
                distances.append(np.linalg.norm(belief.mean - mean))
        errors.append(np.sqrt(np.mean(np.square(distances))))
    assert errors == sorted(errors, reverse=True)
    assert errors[2] < 0.25 * errors[0]
    assert errors[3] < 1e-4


@pytest.mark.parametrize("count", [1, 2, 3, 75])
@given(seed=st.integers(0, 2**32 - 1))
def test_any_number_of_particles_keeps_weights_that_sum_to_one(count, seed):
    model = linear(std=0.01)
    particles = ParticleFilter(
        scene(), np.random.default_rng(seed), count, "systematic" if count % 2 else "multinomial"
    )
    for displacement, travel, strain in sweep(model, 5, seed):
        step(particles, model, strain, displacement, travel)
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
        particles.predict(np.zeros(2), 0.0)
        replaced += np.abs(particles.hypotheses()[0] - 0.025).max(axis=1) > 1e-6
    assert replaced.sum() == 5 * 300
    assert stats.chisquare(replaced).pvalue > 1e-3


def test_constant_injection_happens_at_each_update_and_counts_once_weighted():
    model = linear(std=0.1)
    particles = ParticleFilter(scene(), np.random.default_rng(0), 75, random_particles=10)
    particles.seed(np.array([0.02, 0.03]), np.array([1e-4, 1e-4]))
    for _ in range(5):
        belief, _ = step(particles, model, model.gain @ [0.02, 0.03])
        states, weights = particles.hypotheses()
        far = np.linalg.norm(states - [0.02, 0.03], axis=1) > 0.002
        assert 5 <= far.sum() <= 10
        assert weights[far].sum() < 1e-3
        assert np.linalg.norm(belief.mean - [0.02, 0.03]) < 2e-4


def test_a_wide_belief_has_more_particles_than_a_converged_one():
    model = linear(std=0.05)
    particles = ParticleFilter(scene(), np.random.default_rng(0), 75, max_particles=1500)
    strain = model.gain @ [0.02, 0.03]
    counts = [step(particles, model, strain)[0].hypotheses for _ in range(4)]
    assert counts[0] == 1500
    assert counts[-1] == 75
    particles.predict(np.array([0.06, 0.0]), 0.06)
    assert belief_of(particles).hypotheses == 1500


def test_copies_of_one_ancestor_stay_within_the_bounds():
    particles = ParticleFilter(scene(), np.random.default_rng(0), 1000, resample_below=1.0)
    for _ in range(20):
        assert particles.predict(np.zeros(2), 0.0).left == 0.0
    states, weights = particles.hypotheses()
    for axis in range(2):
        near_a_bound = np.abs(states[:, axis] - 0.025) > 0.022
        assert weights[near_a_bound].sum() == pytest.approx(0.12, abs=0.03)


def test_as_many_random_particles_as_there_are_particles_are_refused():
    with pytest.raises(ParameterError, match="random_particles: expected 0 to 74, got 75"):
        ParticleFilter(scene(), np.random.default_rng(0), 75, random_particles=75)
