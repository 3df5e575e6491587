"""Stamps in a wrong unit are noticed by the travel."""

import numpy as np
import pytest

from tactile_localizer.core.geometry.stamps import StampUnit
from tactile_localizer.errors import MeasurementError

POSITION = np.column_stack([np.linspace(0, 0.05, 500), np.zeros(500)])


def checked(period):
    unit = StampUnit()
    for row, position in enumerate(POSITION):
        unit.check(row * period, position)


@pytest.mark.parametrize("period", [0.0, 0.005, 5.0, 5_000])
def test_stamps_that_stand_still_while_the_palm_travels_are_refused(period):
    with pytest.raises(MeasurementError, match=r"expected ns, the palm travelled \d+ mm in .* ns .*in s"):
        checked(period)


def test_stamps_in_nanoseconds_are_accepted():
    unit = StampUnit()
    for row, position in enumerate(POSITION):
        unit.check(row * 5_000_000, position + (row > 200))  # with a jump of 1 m
    unit.check(0, POSITION[0])


def test_a_stamp_that_is_no_number_is_refused():
    with pytest.raises(MeasurementError, match="stamp_ns: expected a whole number of ns, got None"):
        StampUnit().check(None, POSITION[0])
