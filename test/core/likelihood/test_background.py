"""The background density."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.likelihood.background import Background

BOTH = np.ones(2, bool)
RNG = np.random.default_rng(0)
STRAIN = RNG.standard_normal((500, 16)) * np.linspace(0.1, 2.0, 16) + np.linspace(-1, 1, 16)


def background(strain=STRAIN, strain_std=0.05):
    return Background(strain, np.full(strain.shape[1], strain_std), ChannelLayout((8, 8)))


def test_background_is_a_student_t_density_of_each_present_phalanx():
    measured = STRAIN[7] + 0.3
    scale = 2.0 * np.hypot(STRAIN.std(axis=0), 0.05)
    for phalanx in range(2):
        own, present = slice(8 * phalanx, 8 * phalanx + 8), np.arange(2) == phalanx
        expected = stats.multivariate_t(STRAIN.mean(axis=0)[own], np.diag(scale[own] ** 2), df=3)
        only = np.where(np.repeat(present, 8), measured, 0.0)
        assert background().log_density(only, present) == pytest.approx(expected.logpdf(measured[own]))


@given(away=st.floats(0, 1e12), direction=st.integers(0, 2**32 - 1))
def test_the_log_density_falls_slowly(away, direction):
    unit = np.random.default_rng(direction).standard_normal(16)
    model = background()
    near, far = (model.log_density(unit * distance, BOTH) for distance in (away, 2 * away))
    assert np.isfinite(near)
    assert np.isfinite(far)
    assert near - far < 22 * np.log(2) + 5


@pytest.mark.parametrize("pairs", [1, 2, 3])
def test_few_or_equal_pairs_give_a_density(pairs):
    model = background(np.ones((pairs, 16)), 0.05)
    assert np.isfinite(model.log_density(np.ones(16), BOTH))
    assert model.log_density(np.ones(16), BOTH) > model.log_density(np.full(16, 1.1), BOTH)
