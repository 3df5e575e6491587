"""Checks of measurements."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.likelihood.base import checked
from tactile_localizer.errors import MeasurementError

TWO = ChannelLayout((8, 8))


@given(strain=arrays(np.float64, 16), present=st.none() | arrays(np.bool_, 2))
def test_checked_strains_are_finite(strain, present):
    counted = np.ones(2, bool) if present is None else present
    good = counted.any() and (np.abs(strain[np.repeat(counted, 8)]) < 1e100).all()
    if not good:
        with pytest.raises(MeasurementError):
            checked(strain, TWO, present)
        return
    found, here = checked(strain, TWO, present)
    np.testing.assert_array_equal(here, counted)
    assert np.isfinite(found).all()
    np.testing.assert_array_equal(found[np.repeat(here, 8)], strain[np.repeat(here, 8)])


@pytest.mark.parametrize("wrong", [np.zeros(15), np.zeros((16, 1)), 1.0, []])
def test_a_strain_of_another_shape_is_refused(wrong):
    with pytest.raises(MeasurementError, match=r"strain: expected shape \(16,\), got"):
        checked(wrong, TWO, None)
