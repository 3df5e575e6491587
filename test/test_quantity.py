"""Conversion and range check of numbers from files and parameters."""

import math

import numpy as np
import pytest

from tactile_localizer.errors import ParameterError
from tactile_localizer.quantity import is_number, number, whole_number


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (3, 3.0), (0.5, 0.5), (np.float32(0.25), 0.25), (np.int64(4), 4.0), ("3e-3", 0.003), (".5", 0.5),
        ("5.", 5.0), (" -1.25 ", -1.25), ("+2E1", 20.0), ("pi", math.pi), ("-pi", -math.pi),
        ("2*pi", 2 * math.pi),
        ("-0.5 * pi", -0.5 * math.pi), ("pi/2", math.pi / 2), ("3*pi/4", 3 * math.pi / 4),
    ],
)  # fmt: skip
def test_numbers_and_their_text_are_converted(value, expected):
    assert number(value, "offset") == pytest.approx(expected, rel=1e-15)
    assert type(number(value, "offset")) is float


@pytest.mark.parametrize(
    "value",
    [
        "wide", "", "1,5", "1_000", "0x10", "1e", "--1", "pi*2*pi", "pi/0", "pipi", "2 pi", "e", "nan", "NaN",
        "\N{ARABIC-INDIC DIGIT ONE}", "1" * 50,
        True, False, None, [1], {}, b"1", float("nan"), float("inf"), "-inf", 10**400, complex(1), object(),
    ],
)  # fmt: skip
def test_invalid_numbers_are_rejected_in_one_short_line(value):
    with pytest.raises(ParameterError, match=r"^offset: expected a finite number, got ") as refusal:
        number(value, "offset")
    assert len(str(refusal.value)) < 120


def test_infinity_may_be_allowed():
    assert number("-.inf", "bound", finite=False) == -math.inf
    assert number(math.inf, "bound", finite=False) == math.inf
    with pytest.raises(ParameterError):
        number(math.nan, "bound", finite=False)


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
    assert [whole_number(value, "particles") for value in (75, 75.0, "75", "3e2")] == [75, 75, 75, 300]
    assert whole_number(2**60 + 1, "particles") == 2**60 + 1
    with pytest.raises(ParameterError, match=r"particles: expected a whole number, got 7\.5"):
        whole_number(7.5, "particles")


def test_other_text_is_not_a_number():
    assert [is_number(value) for value in ("2*pi", 0, "grid", True, None)] == [
        True,
        True,
        False,
        False,
        False,
    ]
