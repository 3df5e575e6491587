"""The hand was put down elsewhere on the map: a change is detected, and taken in once."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_localizer.core.decision.relocation import RELOCATION_RATE, Relocation, relocation_probability

STEP = 0.001


def injected(relocation: Relocation, log_ratio: float, steps: int) -> list[float]:
    """What is injected in so many steps of a millimetre."""
    fractions = []
    for _ in range(steps):
        fractions.append(relocation.predict(STEP, 1.0))
        relocation.update(log_ratio)
    return fractions


def test_the_hand_is_put_down_as_often_as_the_rate_says() -> None:
    assert relocation_probability(STEP) == pytest.approx(STEP * RELOCATION_RATE, rel=1e-3)
    assert relocation_probability(2 * STEP) == pytest.approx(1.0 - (1.0 - relocation_probability(STEP)) ** 2)


def test_a_belief_that_explains_what_is_felt_is_not_disturbed() -> None:
    assert not any(injected(Relocation(), 0.4, 1000))


def test_a_belief_that_is_contradicted_is_soon_spread() -> None:
    relocation = Relocation()
    injected(relocation, 0.4, 1000)
    fractions = injected(relocation, -1.0, 8)
    assert any(fractions)


def test_the_odds_are_those_of_a_change_at_any_step() -> None:
    """Bayes: a change before each step, and from there on the likelihood of unknown material."""
    relocation, ratios = Relocation(), [0.3, -1.0, -0.5]
    for ratio in ratios:
        relocation.predict(STEP, 1.0)
        relocation.update(ratio)
    odds = sum(relocation_probability(STEP) * math.exp(-sum(ratios[first:])) for first in range(len(ratios)))
    relocation.update(-7.0)
    fraction = relocation.predict(0.0, 1.0)
    assert fraction / (1.0 - fraction) == pytest.approx(odds * math.exp(7.0))


def test_what_was_injected_is_not_injected_again() -> None:
    relocation = Relocation()
    relocation.predict(STEP, 1.0)
    relocation.update(-10.0)
    assert relocation.predict(0.0, 1.0) > 0.5
    assert relocation.predict(0.0, 1.0) == 0.0


def test_off_the_map_the_belief_is_uniform() -> None:
    assert Relocation().predict(STEP, 1e-6) == pytest.approx(1.0, abs=0.01)


def test_a_strain_that_nothing_explains_changes_nothing() -> None:
    relocation = Relocation()
    relocation.predict(STEP, 1.0)
    relocation.update(math.nan)
    relocation.update(-10.0)
    assert relocation.predict(0.0, 1.0) > 0.5


@given(st.lists(st.tuples(st.floats(0.0, 10.0), st.floats(0.0, 1.0), st.floats()), max_size=20))
def test_a_fraction_is_between_zero_and_one(steps: list[tuple[float, float, float]]) -> None:
    relocation = Relocation()
    for travel, on_map, log_ratio in steps:
        assert 0.0 <= relocation.predict(travel, on_map) <= 1.0
        relocation.update(log_ratio)
