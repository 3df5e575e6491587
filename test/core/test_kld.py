"""KLD sampling asks for as many particles as the belief occupies bins."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2
from support.scans import scene

from tactile_localizer.core.kld import kld_sample_size


def size(states, weights=None, most=100_000):
    weights = np.full(len(states), 1 / len(states)) if weights is None else weights
    return kld_sample_size(states, weights, scene(), most)


def test_one_bin_needs_the_fewest():
    assert size(np.full((500, 2), 0.0201)) == 20


def test_it_is_the_chi_square_quantile_of_the_occupied_bins():
    """Fox, Eq. 7: 1 / (2 e) times the 99 % quantile with k - 1 degrees of freedom, e = 0.05."""
    cells = (np.stack(np.meshgrid(np.arange(10), np.arange(5)), axis=-1).reshape(-1, 2) + 0.5) * 0.05 / 32
    expected = chi2.ppf(0.99, 49) / (2 * 0.05)
    assert abs(size(cells) - expected) / expected < 0.01


@given(seed=st.integers(0, 2**32 - 1), spread=st.floats(1e-6, 1.0), most=st.integers(1, 5000))
def test_it_stays_within_its_limits_and_grows_with_the_spread(seed, spread, most):
    states = 0.025 + spread * 0.05 * (np.random.default_rng(seed).random((1000, 2)) - 0.5)
    assert min(20, most) <= size(states, most=most) <= most
    assert size(0.025 + 0.5 * (states - 0.025)) <= size(states)


def test_particles_of_no_weight_do_not_count():
    states = np.random.default_rng(0).random((1000, 2)) * 0.05
    weights = np.zeros(1000)
    weights[:2] = 0.5
    assert size(states, weights) < 200
