"""Checks of measurements."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.likelihood.base import checked, flatten_axes
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


def test_a_strain_may_be_a_list():
    found, _ = checked([1] * 8, ChannelLayout((8,)), None)
    assert found.dtype == np.float64


def test_the_given_strain_is_not_modified():
    strain = np.full(16, np.nan)
    strain[:8] = 1.0
    checked(strain, TWO, np.array([True, False]))
    assert np.isnan(strain[8:]).all()


def test_axes_are_flattened_in_c_order():
    states = flatten_axes([np.array([1.0, 2.0]), np.array([3.0, 4.0, 5.0])])
    assert states.tolist() == [[1, 3], [1, 4], [1, 5], [2, 3], [2, 4], [2, 5]]
