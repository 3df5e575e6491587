"""The background density."""

import numpy as np
import pytest
from scipy import stats

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.likelihood.background import Background

RNG = np.random.default_rng(0)
STRAIN = RNG.standard_normal((500, 16)) * np.linspace(0.1, 2.0, 16) + np.linspace(-1, 1, 16)


def test_background_is_a_student_t_density_of_each_present_phalanx():
    background, measured = Background(STRAIN, np.full(16, 0.05), ChannelLayout((8, 8))), STRAIN[7] + 0.3
    scale = 2.0 * np.hypot(STRAIN.std(axis=0), 0.05)
    for phalanx in range(2):
        own, present = slice(8 * phalanx, 8 * phalanx + 8), np.arange(2) == phalanx
        expected = stats.multivariate_t(STRAIN.mean(axis=0)[own], np.diag(scale[own] ** 2), df=3)
        only = np.where(np.repeat(present, 8), measured, 0.0)
        assert background.log_density(only, present) == pytest.approx(expected.logpdf(measured[own]))
