"""Strain kernels of a block of pairs, without cancellation or underflow."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_localizer.channels import DEFAULT_CHANNELS, ChannelLayout
from tactile_localizer.core.likelihood.kernels.grid import REACH
from tactile_localizer.core.likelihood.kernels.pair_block import HEADROOM, PairBlock


def block_of(positions: np.ndarray, strain: np.ndarray) -> PairBlock:
    layout = ChannelLayout((DEFAULT_CHANNELS,) * (len(strain) // DEFAULT_CHANNELS))
    low, high = positions.min(axis=0) - 2 * REACH, positions.max(axis=0) + 2 * REACH
    return PairBlock(positions, strain, low, high, layout)


def kernel(states: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Gaussian kernel of unit width, (P, M)."""
    difference = states[:, None, :] - positions[None, :, :]
    return np.exp(-0.5 * np.sum(difference**2, axis=2))


@given(
    seed=st.integers(0, 2**32 - 1),
    scale=st.sampled_from([1e-6, 1.0, 1e3, 1e6]),
    away=st.sampled_from([0.0, 1.0, 1e3, 1e6]),
    dtype=st.sampled_from([np.float64, np.float32]),
)
def test_strain_kernels_neither_cancel_nor_underflow(seed, scale, away, dtype):
    """Differences of log-weights are preserved for strains of any size and distance."""
    rng = np.random.default_rng(seed)
    strain = (scale * rng.standard_normal((2 * DEFAULT_CHANNELS, 30))).astype(dtype)
    measured = strain[:, 3].astype(float) + rng.standard_normal(2 * DEFAULT_CHANNELS) + away * scale
    _, weights, log_scale = block_of(rng.random((30, 2)), strain).strain_weights(measured, np.ones(2, bool))
    squared = np.sum((strain.astype(float) - measured[:, None]) ** 2, axis=0)
    assert np.log(weights.max()) == pytest.approx(HEADROOM, abs=0.02)
    weights, log_scale = weights / np.exp(HEADROOM), log_scale + HEADROOM
    assert log_scale == pytest.approx(-0.5 * squared.min(), rel=1e-5, abs=0.01)
    expected = np.exp(-0.5 * (squared - squared.min()))
    # float32 holds squared distances to seven digits: where they are large, small weights are uncertain.
    slack = 0.01 + 4 * float(np.finfo(dtype).eps) * squared.min()
    clear = np.abs(np.log(np.maximum(expected, 1e-30))) < 60
    np.testing.assert_allclose(np.log(np.maximum(weights[clear], 1e-30)), np.log(expected[clear]), atol=slack)


@given(seed=st.integers(0, 2**32 - 1))
def test_an_absent_phalanx_does_not_affect_weights(seed):
    rng = np.random.default_rng(seed)
    positions, strain = rng.random((20, 2)), rng.standard_normal((2 * DEFAULT_CHANNELS, 20))
    measured = rng.standard_normal(2 * DEFAULT_CHANNELS)
    both = block_of(positions, strain).strain_weights(
        np.where(np.arange(16) < 8, measured, 0.0), np.array([True, False])
    )
    alone = block_of(positions, strain[:DEFAULT_CHANNELS]).strain_weights(
        measured[:DEFAULT_CHANNELS], np.ones(1, bool)
    )
    np.testing.assert_allclose(both[1], alone[1], rtol=1e-9)
    assert both[2] == pytest.approx(alone[2], abs=1e-9)


@given(seed=st.integers(0, 2**32 - 1), log_floor=st.floats(-60.0, -5.0))
def test_omitted_pairs_are_negligible_beside_the_floor(seed, log_floor):
    rng = np.random.default_rng(seed)
    positions, strain = 3.0 * rng.random((400, 2)), 4.0 * rng.standard_normal((2 * DEFAULT_CHANNELS, 400))
    measured = strain[:, 5] + rng.standard_normal(2 * DEFAULT_CHANNELS)
    block, present = block_of(positions, strain), np.ones(2, bool)
    _, weights, log_scale = block.strain_weights(measured, present)
    pairs, few, few_scale = block.strain_weights(measured, present, log_floor)
    assert few_scale == log_scale
    assert pairs is not None, "pairs 4 widths apart in 16 dimensions are far from most"
    assert 5 in pairs
    left_out = weights.sum() - few.sum()
    assert left_out * np.exp(log_scale) <= 1.001e-4 * np.exp(log_floor)
    whole, part = block.spread(None, weights), block.spread(pairs, few)
    assert np.abs(whole - part).max() <= left_out + 1e-5 * whole.max()


@given(seed=st.integers(0, 2**32 - 1), dimension=st.integers(1, 3))
def test_direct_sum(seed, dimension):
    rng = np.random.default_rng(seed)
    positions, weights = rng.random((50, dimension)) * 4, rng.random((50, 2))
    states = rng.random((9, dimension)) * 4
    block = block_of(positions, rng.standard_normal((DEFAULT_CHANNELS, 50)))
    np.testing.assert_allclose(
        block.direct_sum(states, weights), kernel(states, positions) @ weights, rtol=1e-10
    )
