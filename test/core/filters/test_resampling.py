"""Resampling draws particles in proportion to their weights, never one that is not there."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from tactile_localizer.core.filters.resampling import RESAMPLERS, evenly, resampler
from tactile_localizer.errors import ParameterError

every_scheme = pytest.mark.parametrize("name", RESAMPLERS)
WEIGHTS = st.lists(st.floats(0, 1) | st.just(0.0) | st.floats(0, 1e-300), min_size=1, max_size=50).filter(any)


class Fixed:
    """A generator that always draws the same number: the ends of [0, 1) are where rounding bites."""

    def __init__(self, value: float) -> None:
        self.value = value

    def random(self, size=None):
        return self.value if size is None else np.full(size, self.value)


@every_scheme
@given(
    weights=WEIGHTS, count=st.integers(1, 200), seed=st.integers(0, 2**32 - 1), dtype=st.sampled_from("df")
)
def test_ancestors_exist_and_have_weight(name, weights, count, seed, dtype):
    weights = np.array(weights, dtype=dtype)
    weights = weights / weights.sum() if weights.any() else np.eye(1, len(weights), dtype=dtype)[0]
    if not np.isfinite(weights).all():
        return
    ancestors = RESAMPLERS[name](weights, count, np.random.default_rng(seed))
    assert len(ancestors) == count
    assert ancestors.min() >= 0
    assert ancestors.max() < len(weights)
    assert (weights[ancestors] > 0).all()


@every_scheme
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("draw", [0.0, 0.5, math.nextafter(1.0, 0.0)])
@pytest.mark.parametrize("count", [1, 75, 1_000_000])
def test_extreme_draws_give_valid_ancestors(name, dtype, draw, count):
    weights = np.zeros(1000, dtype=dtype)
    weights[3:990] = np.random.default_rng(0).random(987)
    weights /= weights.sum()
    ancestors = RESAMPLERS[name](weights, count, Fixed(draw))
    assert len(ancestors) == count
    assert ancestors.min() >= 3
    assert ancestors.max() < 990


@every_scheme
@pytest.mark.parametrize("total", [1.0, 0.9999, 1.0001, 1e-6, 1e6])
def test_weights_need_not_sum_to_one_exactly(name, total):
    """Sums of float32 weights are off by 1e-7 times their number: no lineage may be cut for that."""
    weights = np.full(8, total / 8)
    ancestors = RESAMPLERS[name](weights, 8000, np.random.default_rng(0))
    assert np.bincount(ancestors, minlength=8) == pytest.approx(np.full(8, 1000), abs=150)


@every_scheme
@pytest.mark.parametrize("count", [7, 10])
def test_resampling_is_unbiased(name, count):
    """Chi-square over many seeds: the mean number of copies is count times the weight."""
    weights = np.array([0.02, 0.3, 0.0, 0.08, 0.25, 0.05, 0.3])
    rounds = 4000
    copies = np.stack(
        [
            np.bincount(RESAMPLERS[name](weights, count, np.random.default_rng(seed)), minlength=7)
            for seed in range(rounds)
        ]
    )
    expected = count * weights
    drawn = weights > 0
    assert (copies[:, ~drawn] == 0).all()
    # Copies of different particles are correlated, so each is tested by itself (Bonferroni over the six).
    error = copies.mean(axis=0)[drawn] - expected[drawn]
    spread = copies.std(axis=0)[drawn] / math.sqrt(rounds)
    certain = spread < 1e-12
    assert np.abs(error[certain]).max(initial=0.0) < 1e-12
    p_values = stats.chi2.sf((error[~certain] / spread[~certain]) ** 2, df=1)
    assert p_values.min(initial=1.0) > 1e-3 / drawn.sum()


@every_scheme
def test_resampling_is_unbiased_in_any_order(name):
    """Pooled chi-square goodness of fit: one draw a seed, random weights, sorted up and down."""
    rng = np.random.default_rng(1)
    for order in (1, -1):
        weights = np.sort(rng.dirichlet(np.ones(12)))[::order]
        ancestors = [RESAMPLERS[name](weights, 1, np.random.default_rng(seed))[0] for seed in range(5000)]
        assert stats.chisquare(np.bincount(ancestors, minlength=12), 5000 * weights).pvalue > 1e-3


@every_scheme
def test_a_certain_particle_is_the_only_ancestor(name):
    weights = np.zeros(100)
    weights[42] = 1.0
    assert (RESAMPLERS[name](weights, 1000, np.random.default_rng(0)) == 42).all()


@every_scheme
def test_low_variance_schemes_keep_heavy_particles(name):
    """Four shares leave at least three copies; independent draws promise nothing."""
    weights = np.array([0.35, 0.25, 0.2, 0.2])
    least = [
        np.bincount(RESAMPLERS[name](weights, 20, np.random.default_rng(seed)), minlength=4).min()
        for seed in range(200)
    ]
    assert min(least) >= (0 if name == "multinomial" else 3)


@every_scheme
def test_a_million_particles_are_resampled(name):
    weights = np.random.default_rng(0).random(1_000_000)
    weights /= weights.sum()
    ancestors = RESAMPLERS[name](weights, 1_000_000, np.random.default_rng(1))
    assert len(ancestors) == 1_000_000
    assert weights[ancestors].mean() == pytest.approx(np.sum(weights**2), rel=0.01)


@every_scheme
def test_the_scheme_is_found_by_name(name):
    assert resampler(name) is RESAMPLERS[name]
    with pytest.raises(ParameterError, match=r"resampling 'x': expected one of systematic, stratified"):
        resampler("x")


@given(weights=WEIGHTS, count=st.integers(1, 200))
def test_evenly_is_systematic_with_a_central_offset(weights, count):
    np.testing.assert_array_equal(
        evenly(weights, count), RESAMPLERS["systematic"](weights, count, Fixed(0.5))
    )


def test_evenly_is_proportional_to_the_weights():
    np.testing.assert_array_equal(evenly([0.25, 0.0, 0.5, 0.25], 8), [0, 0, 2, 2, 2, 2, 3, 3])
