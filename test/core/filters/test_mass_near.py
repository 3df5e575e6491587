"""The mass near the mean is what the states within an ellipsoid weigh, in both filters."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tactile_localizer.core.filters.base import BayesFilter
from tactile_localizer.core.filters.grid import GridFilter
from tactile_localizer.core.filters.particle import ParticleFilter
from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.scene import Axis, Phalanx, Scene

PLANE = Scene("plane", (Axis("x", -0.02, 0.02), Axis("y", -0.02, 0.02)), (Phalanx("index", (0.0, 0.0)),))
SPACE = Scene("space", (*PLANE.axes, Axis("yaw", -math.pi, math.pi)), (Phalanx("index", (0.0, 0.0, 0.0)),))


def filters(scene: Scene) -> list[BayesFilter]:
    cell = (scene.upper - scene.lower) / 100.0
    return [GridFilter(scene, cell), ParticleFilter(scene, np.random.default_rng(0), 20_000)]


@pytest.mark.parametrize("kind", [0, 1])
def test_two_sigma_of_a_gaussian_in_the_plane(kind: int) -> None:
    made = filters(PLANE)[kind]
    made.seed(np.zeros(2), np.array([0.002, 0.004]))
    near = made.mass_near(np.zeros(2), np.array([0.004, 0.008]))
    assert near == pytest.approx(1.0 - math.exp(-2.0), abs=0.01)


@pytest.mark.parametrize("kind", [0, 1])
def test_it_is_the_weight_of_the_states_in_the_ellipsoid_also_across_the_turn(kind: int) -> None:
    made = filters(SPACE)[kind]
    made.seed(np.array([0.003, -0.001, 3.1]), np.array([0.004, 0.004, 0.3]))
    mean, radius = made.belief().mean, np.array([0.006, 0.005, 0.4])
    states, weights = made.hypotheses()
    deviation = states - mean
    deviation[:, 2] = wrap_angle(deviation[:, 2])
    inside = np.sum((deviation / radius) ** 2, axis=1) <= 1.0
    assert made.mass_near(mean, radius) == pytest.approx(weights[inside].sum(), abs=3e-4)  # negligible cells


def test_nothing_is_near_a_place_outside() -> None:
    for made in filters(PLANE):
        assert made.mass_near(np.full(2, 1.0), np.full(2, 0.005)) == 0.0


def test_moments_of_a_grid_are_those_of_its_cells() -> None:
    grid = GridFilter(SPACE, np.array([0.001, 0.001, 0.1]))
    rng = np.random.default_rng(1)
    states, log_prior = grid.prior()
    ridge = -0.5 * ((states[:, 0] - states[:, 1] - 0.002 * states[:, 2]) / 0.02) ** 2
    turn = -0.2 * wrap_angle(states[:, 2] - 3.0) ** 2
    grid.update(ridge + turn + 0.1 * rng.standard_normal(len(log_prior)))
    states, weights = grid.hypotheses()
    belief = grid.belief()
    mean = weights @ states
    mean[2] = math.atan2(weights @ np.sin(states[:, 2]), weights @ np.cos(states[:, 2]))
    deviation = states - mean
    deviation[:, 2] = wrap_angle(deviation[:, 2])
    covariance = (deviation * weights[:, None]).T @ deviation
    np.testing.assert_allclose(belief.mean, mean, atol=1e-8)
    off_diagonal = ~np.eye(3, dtype=bool)
    np.testing.assert_allclose(belief.covariance[off_diagonal], covariance[off_diagonal], atol=1e-8)
    assert belief.hypotheses == len(weights)
    assert belief.effective_sample_size == pytest.approx(1.0 / (weights @ weights), rel=1e-6)
