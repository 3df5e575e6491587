"""One grammar names columns, fields and signals."""

from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_localizer.errors import ParameterError
from tactile_localizer.io.can.layout import SignalNames
from tactile_localizer.io.names import expanded, parse_names, ranges


@pytest.mark.parametrize(
    ("name", "first", "count", "last"),
    [
        ("gauge_1..8", "gauge_1", 8, "gauge_8"),
        ("g08..11", "g08", 4, "g11"),
        ("0..2", "0", 3, "2"),
        ("taxels.0..15.force", "taxels.0.force", 16, "taxels.15.force"),
        ("/skin/data[0..3]", "/skin/data[0]", 4, "/skin/data[3]"),
        ("plain", "plain", 1, "plain"),
    ],
)
def test_a_range_of_numbers_is_as_many_names(name, first, count, last):
    found = expanded(name, "here")
    assert (found[0], len(found), found[-1]) == (first, count, last)


@pytest.mark.parametrize(
    ("given", "names", "factor"),
    [
        ("a, b * 2", ("a", "b"), Decimal(2)),
        ("a / 4", ("a",), Decimal("0.25")),
        ("row/50", ("row",), Decimal("0.02")),
        ("/skin/0", ("/skin/0",), Decimal(1)),
        ("Kraft / N", ("Kraft / N",), Decimal(1)),
        (["a / 4", "b, N * 2"], ("a / 4", "b, N * 2"), Decimal(1)),
    ],
)
def test_a_factor_is_a_number_behind_the_names(given, names, factor):
    found = parse_names(given, "here")
    assert (found.names, set(found.factors)) == (names, {factor})


@pytest.mark.parametrize("given", ["a * x", "a / 0", "a3..1", "", 7, [7], []])
def test_what_is_no_name_is_refused(given):
    with pytest.raises(ParameterError, match=r"^here: expected"):
        parse_names(given, "here")


def test_signals_of_a_log_are_named_as_columns_are():
    assert SignalNames(["left_1..2", "right"]).gauge_signals == ("left_1", "left_2", "right")


@given(st.sets(st.integers(0, 60), min_size=1))
def test_ranges_are_what_they_expand_to(numbers):
    text = ranges(sorted(numbers))
    found = [int(number) for part in text.split(", ") for number in expanded(part, "here")]
    assert found == sorted(numbers)
