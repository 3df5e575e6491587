"""Deformation of the material along a sweep."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tactile_localizer.sim.deformation import deformation, mode_of_sweep
from tactile_localizer.sim.material import MODES

X = np.linspace(-30e-3, 20e-3, 700)


def draw(seed, mode):
    return deformation(np.random.default_rng(seed), mode, X, 70e-6)


@given(st.integers(0, 10_000), st.integers(0, len(MODES) - 1))
def test_mode_weights_sum_to_one(seed, mode):
    np.testing.assert_allclose(np.sum(draw(seed, mode).weights, axis=1), 1)


def test_deformation_is_flattened_behind_the_middle():
    weights = np.mean([draw(seed, 1).weights for seed in range(200)], axis=0)
    assert weights[X < -15e-3, 1].min() > 0.9
    assert weights[X > 10e-3, 1].max() < 0.3


def test_some_sweeps_change_mode():
    before_middle = np.searchsorted(X, 0.0)
    kept = np.mean([draw(seed, 1).weights[before_middle, 1] > 0.5 for seed in range(400)])
    assert 0.6 < kept < 0.85


def test_stretch_is_small_and_continuous():
    stretch = np.stack([draw(seed, 0).stretch for seed in range(200)])
    assert 0.3e-3 < np.std(stretch) < 0.6e-3
    assert np.max(np.abs(np.diff(stretch, axis=1))) < 0.05e-3


def test_modes_of_consecutive_sweeps_correlate():
    modes = np.array([mode_of_sweep(np.random.default_rng(4), number) for number in range(600)])
    assert np.all(np.bincount(modes, minlength=len(MODES)) > 120)
    assert 0.5 < np.mean(modes[1:] == modes[:-1]) < 0.75
