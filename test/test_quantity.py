"""Range checks of numbers from files and parameters."""

import math

import numpy as np
import pytest

from tactile_localizer.errors import ParameterError
from tactile_localizer.quantity import number, whole_number


@pytest.mark.parametrize("value", [3, 3.0, np.float32(3), np.int64(3)])
def test_numbers_are_converted(value):
    assert number(value, "offset") == 3.0
    assert type(number(value, "offset")) is float


@pytest.mark.parametrize(
    "value", ["3", "pi", "", True, None, [1], {}, b"1", math.nan, math.inf, 10**400, 1j, object()]
)
def test_anything_else_is_rejected_in_one_short_line(value):
    with pytest.raises(ParameterError, match=r"^offset: expected a finite number, got ") as refusal:
        number(value, "offset")
    assert len(str(refusal.value)) < 120


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"lower": 0.0, "upper": 1.0}, "cell: expected 0 to 1, got 7"),
        ({"lower": 8.0}, "cell: expected at least 8, got 7"),
        ({"upper": 6.0}, "cell: expected at most 6, got 7"),
    ],
)
def test_a_number_out_of_range_is_rejected_with_the_range(limits, message):
    with pytest.raises(ParameterError, match=message):
        number(7, "cell", **limits)


def test_integers_may_be_written_as_floats():
    assert [whole_number(value, "particles") for value in (75, 75.0, 2**60 + 1)] == [75, 75, 2**60 + 1]
    with pytest.raises(ParameterError, match=r"particles: expected a whole number, got 7\.5"):
        whole_number(7.5, "particles")
