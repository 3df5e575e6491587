"""A strain counts for as much as it says that the ones before it did not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_localizer.core.correlation import Correlation

BOTH = np.ones(2, dtype=bool)
STILL = np.zeros(16)
WIDTHS = np.full(16, 0.02)
STEP = 0.001


def second(correlation: Correlation, strain: np.ndarray, felt: np.ndarray = BOTH, before=BOTH) -> float:
    """Share of a strain that is felt a millimetre after one of zeros."""
    correlation.share(STILL, before, STEP)
    return correlation.share(strain, felt, STEP)


def test_without_change_the_travel_alone_counts() -> None:
    assert Correlation(0.004, 6.0, WIDTHS).share(STILL, BOTH, STEP) == pytest.approx(0.25)
    assert second(Correlation(0.004, 6.0, WIDTHS), STILL) == pytest.approx(0.25)


def test_a_change_of_the_stated_size_makes_an_independent_measurement() -> None:
    assert second(Correlation(1.0, 4.0, WIDTHS), 3.0 * WIDTHS) == pytest.approx(0.75, rel=1e-3)
    assert second(Correlation(0.004, 4.0, WIDTHS), 4.0 * WIDTHS) == 1.0


def test_no_change_counts_where_none_is_stated() -> None:
    assert second(Correlation(0.004, None, WIDTHS), 100.0 * WIDTHS) == pytest.approx(0.25)


def test_a_phalanx_that_was_not_felt_both_times_says_nothing_of_change() -> None:
    change = np.concatenate([np.zeros(8), np.full(8, 0.08)])
    only_first, only_second = np.array([True, False]), np.array([False, True])
    assert second(Correlation(0.004, 4.0, WIDTHS), change, only_first) == pytest.approx(0.25)
    assert second(Correlation(0.004, 4.0, WIDTHS), change, only_second) == 1.0
    assert second(Correlation(0.004, 4.0, WIDTHS), change, only_second, before=only_first) == pytest.approx(
        0.25
    )


def test_one_gauge_that_jumps_does_not_make_a_measurement_alone() -> None:
    jump = np.zeros(16)
    jump[3] = 1e6
    assert second(Correlation(1.0, 8.0, WIDTHS), jump) == pytest.approx(5.0 / 4.0 / 8.0, rel=1e-3)


@pytest.mark.parametrize("step", [0.0001, 0.00025, 0.0005, 0.001, 0.002])
def test_noise_counts_alike_however_often_strains_are_weighed(step: float) -> None:
    """Else a filter that weighs more often would become overconfident on noise."""
    rng = np.random.default_rng(0)
    correlation = Correlation(0.02, 4.0, WIDTHS)
    travelled = 0.2
    strains = 0.5 * WIDTHS * rng.standard_normal((round(travelled / step), 16))
    total = sum(correlation.share(strain, BOTH, step) for strain in strains)
    each_millimetre = np.hypot(0.001 / 0.02, 0.5 * np.sqrt(2.0) / 4.0)
    assert total == pytest.approx(each_millimetre * 0.001 / max(step, 0.001) * 200, rel=0.1)


def test_strains_a_length_apart_count_in_full_each() -> None:
    correlation = Correlation(0.0005, 4.0, WIDTHS)
    assert [correlation.share(STILL, BOTH, 0.0005) for _ in range(5)] == [1.0] * 5


def test_a_new_sweep_has_no_past() -> None:
    correlation = Correlation(0.004, 4.0, WIDTHS)
    correlation.share(STILL, BOTH, STEP)
    correlation.reset()
    assert correlation.share(100.0 * WIDTHS, BOTH, STEP) == pytest.approx(0.25)


@given(st.floats(1e-5, 1.0), st.lists(st.floats(-1e3, 1e3), min_size=16, max_size=16))
def test_the_share_of_a_way_is_between_that_of_the_travel_and_one(travel: float, change: list[float]) -> None:
    correlation = Correlation(0.01, 4.0, WIDTHS)
    correlation.share(STILL, BOTH, travel)
    share = correlation.share(np.array(change), BOTH, travel)
    assert min(1.0, travel / 0.01) * (1.0 - 1e-12) <= share <= 1.0
