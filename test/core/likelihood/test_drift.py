"""Innovations: what a level and a rate do not predict from the strains before."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.models import KalmanFilter, LinearModel

from tactile_localizer.core.likelihood.ancestry import Ancestry
from tactile_localizer.core.likelihood.drift import Drift, Trend, innovations

STEP, UNKNOWN = 0.0005, np.full(2, np.inf)
NOWHERE = np.zeros((0, 2), dtype=np.float32)
MEMORIES = (0.01, np.inf)


def of_strains(drift: Drift, strains: np.ndarray) -> np.ndarray:
    """Innovations (n, C) of strains (n, C)."""
    trend, found = drift.start(0), []
    for strain in strains:
        innovation, trend = drift.update(trend, strain, NOWHERE, STEP, 1.0)
        found.append(innovation.of_strain)
    return np.array(found)


@given(
    seed=st.integers(0, 2**32 - 1), memory=st.sampled_from(MEMORIES), variance=st.sampled_from([1.0, np.inf])
)
def test_the_innovation_of_strain_less_map_is_that_of_their_difference(
    seed: int, memory: float, variance: float
) -> None:
    """Along the way of each trajectory, however the trajectories continue each other."""
    rng = np.random.default_rng(seed)
    drift, trajectories, steps = Drift(memory, 1.0, np.full(2, variance)), 5, 20
    strains = 10.0 * rng.standard_normal((steps, 2))
    trend, felt = drift.start(trajectories), np.zeros((0, trajectories, 2))
    for strain in strains:
        ancestors = rng.integers(0, trajectories, trajectories)
        trend = trend.followed(Ancestry(ancestors, np.ones(trajectories), np.zeros(0), np.ones(trajectories)))
        felt = felt[:, ancestors]
        expected = 10.0 * rng.standard_normal((trajectories, 2)).astype(np.float32)
        innovation, trend = drift.update(trend, strain, expected, STEP, 1.0)
        felt = np.concatenate([felt, expected[None]])
    for trajectory in range(trajectories):
        direct = of_strains(drift, strains - felt[:, trajectory])[-1]
        found = innovation.of_strain - innovation.of_map[trajectory]
        np.testing.assert_allclose(found, direct, atol=1e-4)


@pytest.mark.parametrize("prior", [0.1, 1.0, 25.0])
def test_a_constant_with_a_prior_is_the_kalman_filter(prior: float) -> None:
    noise = 2.0
    drift = Drift(np.inf, noise, np.full(2, prior))
    kalman = KalmanFilter(np.zeros(2), prior * np.eye(2), LinearModel(np.eye(2), math.sqrt(noise)))
    trend = drift.start(0)
    for strain in np.random.default_rng(0).normal(5.0, 1.4, (50, 2)):
        innovation, trend = drift.update(trend, strain, NOWHERE, STEP, 1.0)
        np.testing.assert_allclose(innovation.of_strain, strain - kalman.mean)
        np.testing.assert_allclose(innovation.level_variance, np.diag(kalman.covariance))
        kalman.update(strain)
        np.testing.assert_allclose(trend.level, kalman.mean)


def test_the_first_strain_of_an_unknown_level_carries_no_information() -> None:
    drift = Drift(np.inf, 1.0, UNKNOWN)
    innovation, trend = drift.update(drift.start(0), np.full(2, 1e3), NOWHERE, STEP, 1.0)
    assert innovation.level_variance.min() > 1e8
    innovation, _ = drift.update(trend, np.full(2, 1e3), NOWHERE, STEP, 1.0)
    np.testing.assert_allclose(innovation.level_variance, 1.0, rtol=1e-3)


def test_innovations_along_a_sweep_are_those_of_the_filter() -> None:
    strains = np.random.default_rng(0).standard_normal((50, 2))
    found = innovations(strains, 0.01, STEP)
    np.testing.assert_allclose(found[1:], of_strains(Drift(0.01, 1.0, UNKNOWN), strains)[1:])
    assert not found[0].any()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("offset", [0.0, 5e-9, 1.0, 1e5])
def test_values_that_hardly_change_have_finite_innovations(offset: float) -> None:
    """As differences of two sweeps in whole counts."""
    values = np.full((30, 2), offset)
    values[20:, 1] += 3.0
    found = innovations(values, 0.05, STEP, robust=True)
    assert np.isfinite(found).all()
    np.testing.assert_allclose(found[1:20], 0.0, atol=1e-8 * offset)
    assert found[20, 1] == pytest.approx(3.0, abs=1e-2)


@pytest.mark.parametrize("memory", MEMORIES)
def test_a_channel_that_is_not_measured_keeps_its_trend_and_does_not_change_that_of_others(
    memory: float,
) -> None:
    """A strain of zero stands for it, far from its level, which would be an outlier of all channels."""
    both, alone = (Drift(memory, 1.0, np.full(n, 100.0), 1e3) for n in (2, 1))
    rng, measured = np.random.default_rng(0), np.array([True, False])
    known = Trend(np.array([0.0, 7.0]), np.array([0.0, 500.0]), np.zeros(2), np.zeros((2, 3, 2), np.float32))
    trend, of_one = known, alone.start(3)
    for _ in range(20):
        strain, of_map = rng.standard_normal(2) * measured, rng.standard_normal((3, 2)).astype(np.float32)
        found, trend = both.update(trend, strain, of_map, STEP, 0.3, measured)
        expected, of_one = alone.update(of_one, strain[:1], of_map[:, :1].copy(), STEP, 0.3)
        np.testing.assert_allclose(found.of_strain[:1], expected.of_strain, rtol=1e-9)
        np.testing.assert_allclose(found.of_map[:, :1], expected.of_map, rtol=1e-5)
    for now, before in zip(trend, known, strict=True):
        np.testing.assert_array_equal(np.asarray(now)[..., 1], np.asarray(before)[..., 1])
