"""A belief that is contradicted is spread again, and one that is not is left alone."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_localizer.core.recovery import Recovery


def spread(log_ratio, way, step=0.0005):
    """Share of the first belief that is left after a way of constant contradiction."""
    recovery, left = Recovery(), 1.0
    for _ in range(round(way / step)):
        left *= 1.0 - recovery.fraction(log_ratio, step)
    return left


@pytest.mark.parametrize("log_ratio", [20.0, 1.0, 0.0, -1.9])
def test_a_belief_that_explains_what_is_felt_is_left_alone(log_ratio):
    assert spread(log_ratio, 0.1) == 1.0


def test_a_wholly_contradicted_belief_is_replaced_within_millimetres():
    assert spread(-1e9, 0.002) > 0.3
    assert spread(-1e9, 0.010) < 0.2
    assert spread(-1e9, 0.030) < 0.01


def test_the_stronger_the_contradiction_the_faster():
    left = [spread(log_ratio, 0.01) for log_ratio in (-3.0, -5.0, -8.0, -15.0)]
    assert left == sorted(left, reverse=True)
    assert len(set(left)) == 4


def test_it_does_not_depend_on_how_a_way_is_cut():
    assert spread(-12.0, 0.01, 0.0001) == pytest.approx(spread(-12.0, 0.01, 0.0005), abs=0.05)


def test_one_wild_strain_does_not_shake_it():
    recovery = Recovery()
    for _ in range(20):
        recovery.fraction(5.0, 0.0005)
    assert recovery.fraction(-math.inf, 0.0005) == 0.0


@given(st.lists(st.tuples(st.floats(-1e12, 1e12), st.floats(0, 10.0)), max_size=50))
def test_the_share_is_a_share(updates):
    recovery = Recovery()
    for log_ratio, travel in updates:
        assert 0.0 <= recovery.fraction(log_ratio, travel) <= 1.0


def test_a_reset_forgets():
    recovery = Recovery()
    for _ in range(100):
        recovery.fraction(-20.0, 0.001)
    recovery.reset()
    assert recovery.fraction(0.0, 0.001) == 0.0
