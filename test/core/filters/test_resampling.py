"""Resampling draws particles in proportion to their weights, never one that is not there."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy import stats

from tactile_localizer.core.filters.resampling import systematic

WEIGHTS = st.lists(st.floats(0, 1) | st.just(0.0) | st.floats(0, 1e-300), min_size=1, max_size=50).filter(any)


class Fixed:
    """A generator that always draws the same number: the ends of [0, 1) are where rounding bites."""

    def __init__(self, value: float) -> None:
        self.value = value

    def random(self):
        return self.value


@given(
    weights=WEIGHTS,
    count=st.integers(1, 200),
    draw=st.floats(0.0, 1.0, exclude_max=True),
    dtype=st.sampled_from("df"),
)
@example([0.0, *np.linspace(0.1, 0.9, 987), 0.0], 1_000_000, 0.0, "f")
@example([0.0, *np.linspace(0.1, 0.9, 987), 0.0], 1_000_000, math.nextafter(1.0, 0.0), "f")
def test_ancestors_exist_and_have_weight(weights, count, draw, dtype):
    weights = np.array(weights, dtype=dtype)
    weights = weights / weights.sum() if weights.any() else np.eye(1, len(weights), dtype=dtype)[0]
    ancestors = systematic(weights, count, Fixed(draw))
    assert len(ancestors) == count
    assert (weights[ancestors] > 0).all()


@pytest.mark.parametrize("total", [1.0, 0.9999, 1.0001, 1e-6, 1e6])
def test_weights_need_not_sum_to_one_exactly(total):
    """Sums of float32 weights are off by 1e-7 times their number: no lineage may be cut for that."""
    ancestors = systematic(np.full(8, total / 8), 8000, np.random.default_rng(0))
    assert np.bincount(ancestors, minlength=8) == pytest.approx(np.full(8, 1000), abs=150)


@pytest.mark.parametrize("count", [7, 10])
def test_resampling_is_unbiased(count):
    """Chi-square over many seeds: the mean number of copies is count times the weight."""
    weights, rounds = np.array([0.02, 0.3, 0.0, 0.08, 0.25, 0.05, 0.3]), 4000
    seeds = map(np.random.default_rng, range(rounds))
    copies = np.stack([np.bincount(systematic(weights, count, rng), minlength=7) for rng in seeds])
    drawn = weights > 0
    assert (copies[:, ~drawn] == 0).all()
    # Copies of different particles are correlated, so each is tested by itself (Bonferroni over the six).
    error = copies.mean(axis=0)[drawn] - count * weights[drawn]
    spread = np.maximum(copies.std(axis=0)[drawn] / math.sqrt(rounds), 1e-12)
    assert stats.chi2.sf((error / spread) ** 2, df=1).min() > 1e-3 / drawn.sum()
