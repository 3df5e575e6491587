"""A strain counts for as much as it says that the one before it did not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_localizer.core.correlation import Correlation

BOTH = np.ones(2, dtype=bool)
STILL = np.zeros(16)
WIDTHS = np.full(16, 0.02)


def test_without_change_the_travel_alone_counts() -> None:
    assert Correlation(0.004, 6.0, WIDTHS).weight(0.001, STILL, BOTH) == pytest.approx(0.25)


def test_a_change_of_the_stated_size_makes_an_independent_measurement() -> None:
    assert Correlation(0.004, 4.0, WIDTHS).weight(0.0, 4.0 * WIDTHS, BOTH) == pytest.approx(1.0)


def test_no_change_counts_where_none_is_stated() -> None:
    assert Correlation(0.004, None, WIDTHS).weight(0.001, 100.0 * WIDTHS, BOTH) == pytest.approx(0.25)


def test_a_phalanx_that_was_not_felt_both_times_says_nothing_of_change() -> None:
    correlation = Correlation(0.004, 4.0, WIDTHS)
    change = np.concatenate([np.zeros(8), np.full(8, 0.08)])
    only_first, only_second = np.array([True, False]), np.array([False, True])
    assert correlation.weight(0.001, change, only_first) == pytest.approx(0.25)
    assert correlation.weight(0.0, change, only_second) == pytest.approx(1.0)
    assert correlation.weight(0.001, change, ~BOTH) == pytest.approx(0.25)


def test_one_gauge_that_jumps_does_not_make_a_measurement_alone() -> None:
    jump = np.zeros(16)
    jump[3] = 1e6
    assert Correlation(0.01, 8.0, WIDTHS).weight(0.0, jump, BOTH) == pytest.approx(5.0 / 4.0 / 8.0)


@given(st.floats(0.0, 1.0), st.lists(st.floats(-1e3, 1e3), min_size=16, max_size=16))
def test_the_share_is_between_that_of_the_travel_and_one(travel: float, change: list[float]) -> None:
    share = Correlation(0.01, 4.0, WIDTHS).weight(travel, np.array(change), BOTH)
    assert min(1.0, travel / 0.01) <= share <= 1.0
