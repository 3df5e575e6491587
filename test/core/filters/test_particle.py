"""The particle filter weights, resamples and injects; with many particles it agrees with exact recursions."""

import numpy as np
import pytest
from scipy import stats
from support.models import LinearModel, step
from support.scans import scene

from tactile_localizer.core.filters.particle import ParticleFilter
from tactile_localizer.errors import ParameterError


def linear(dimension=2, std=1.0, seed=0):
    return LinearModel(np.random.default_rng(seed).standard_normal((16, dimension)) * 50, std)


def test_a_reset_covers_the_scene_evenly_even_with_few_particles():
    states, weights = ParticleFilter(scene(), np.random.default_rng(0), 75).hypotheses()
    for axis in range(2):
        assert np.bincount((states[:, axis] / 0.05 * 75).astype(int), minlength=75).tolist() == [1] * 75
    assert weights == pytest.approx(1 / 75)


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
