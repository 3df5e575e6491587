"""Many states are evaluated by interpolation on a grid, without a visible error."""

import numpy as np
import pytest
from support.scans import SIDE

from tactile_localizer.core.likelihood.kernels.density import interpolated

WIDTH = np.array([0.002, 0.003])


def log_mixture(states):
    """Logarithm of two Gaussians of the given width and a floor."""
    places, heights = np.array([[0.01, 0.02], [0.035, 0.03]]), np.array([0.0, 2.0])
    squared = np.sum(((states[:, None, :] - places) / WIDTH) ** 2, axis=2)
    return np.logaddexp(np.logaddexp.reduce(heights - 0.5 * squared, axis=1), -30.0)


def on_axes(axes):
    states = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return log_mixture(states.reshape(-1, 2)).reshape(states.shape[:-1])


def never(_):
    raise AssertionError("not expected to be asked")


def test_few_states_are_evaluated_directly():
    states = np.random.default_rng(0).random((75, 2)) * SIDE
    np.testing.assert_array_equal(interpolated(states, WIDTH, log_mixture, never), log_mixture(states))


@pytest.mark.parametrize("spread", [0.1, 1.0])
def test_interpolation_is_accurate_near_the_peak(spread):
    rng = np.random.default_rng(0)
    states = np.array([0.035, 0.03]) + spread * (rng.random((5000, 2)) - 0.5) * SIDE * 0.6
    found, expected = interpolated(states, WIDTH, never, on_axes), log_mixture(states)
    near = expected > expected.max() - 5
    assert np.abs(found - expected)[near].max() < 0.01
    assert np.abs(found - expected).max() < 0.5


def test_many_equal_states():
    states = np.tile([[0.01, 0.02]], (1000, 1))
    np.testing.assert_allclose(
        interpolated(states, WIDTH, log_mixture, on_axes), log_mixture(states), atol=1e-3
    )


def test_states_in_a_large_volume_are_evaluated_directly():
    states = np.random.default_rng(0).random((2000, 2)) * 100.0
    np.testing.assert_array_equal(interpolated(states, WIDTH, log_mixture, never), log_mixture(states))
