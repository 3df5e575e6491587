"""Kernel sums by a grid agree with direct sums."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_localizer.core.likelihood.kernels.grid import KernelGrid, TabulatedField


def kernel(states: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Gaussian kernel of unit width, (P, M)."""
    difference = states[:, None, :] - positions[None, :, :]
    return np.exp(-0.5 * np.sum(difference**2, axis=2))


@pytest.mark.parametrize("dimension", [1, 2, 3])
@given(seed=st.integers(0, 2**32 - 1))
def test_the_grid_follows_a_lone_pair_wherever_it_lies_between_nodes(dimension, seed):
    rng = np.random.default_rng(seed)
    anchor = np.zeros((1, dimension))
    pair = rng.random((1, dimension)) * 3
    grid = KernelGrid(np.concatenate([anchor, pair]))
    direction = rng.standard_normal((50, dimension))
    distance = rng.random((50, 1)) * np.sqrt(10)  # 5 nats below the peak
    states = pair + direction / np.linalg.norm(direction, axis=1, keepdims=True) * distance
    summed = grid.at_states(states, grid.spread(np.array([0.0, 1.0])))
    error = np.log(summed) - np.log(kernel(states, pair)[:, 0])
    assert np.abs(error).max() < 0.006


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_the_grid_sums_on_axes_what_it_sums_at_states(dimension):
    rng = np.random.default_rng(0)
    positions = rng.random((40, dimension)) * 5
    grid = KernelGrid(positions)
    field = grid.spread(rng.random(40))
    axes = [np.sort(rng.random(3 + axis)) * 5 for axis in range(dimension)]
    states = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, dimension)
    on_axes = grid.on_axes(axes, field)
    assert on_axes.shape == tuple(3 + axis for axis in range(dimension))
    np.testing.assert_allclose(on_axes.ravel(), grid.at_states(states, field), rtol=1e-5)


def test_long_axes_leave_out_only_what_is_negligible():
    rng = np.random.default_rng(0)
    positions = rng.random((300, 2)) * [300.0, 4.0]
    grid = KernelGrid(positions)
    weights = rng.random(300)
    states = rng.random((50, 2)) * [300.0, 4.0]
    np.testing.assert_allclose(
        grid.at_states(states, grid.spread(weights)),
        kernel(states, positions) @ weights,
        rtol=5e-3,
        atol=1e-5,
    )


def test_many_states_on_a_large_grid_need_no_more_memory_than_few():
    import tracemalloc

    rng = np.random.default_rng(0)
    grid = KernelGrid(rng.random((30, 3)) * [4.0, 12.0, 12.0])
    field = grid.spread(np.ones(30))
    states = rng.random((20_000, 3)) * 4
    tracemalloc.start()
    grid.at_states(states, field)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 150e6


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_the_tabulated_density_is_the_sum_of_the_position_kernels(dimension):
    rng = np.random.default_rng(0)
    positions = rng.random((200, dimension)) * 4
    grid = KernelGrid(positions)
    density = TabulatedField(
        grid, grid.spread(np.ones(200)), positions.min(axis=0) - 10, positions.max(axis=0) + 10
    )
    states = rng.random((100, dimension)) * 6 - 1
    exact = kernel(states, positions).sum(axis=1)
    assert np.abs(density(states) - exact).max() < 1e-3 * exact.max()
