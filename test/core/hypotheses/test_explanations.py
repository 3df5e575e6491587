"""The hidden Markov model over the explanations of a strain."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_localizer.core.hypotheses.explanations import (
    RELOCATION_DISTANCE,
    RELOCATION_RATE,
    Explanations,
)

PLACES, PITCH = 20, 0.0005
IMPOSSIBLE = -math.inf
NONE = np.zeros(PLACES, dtype=bool)


def at_one_place(log_likelihood: float, places: int = PLACES) -> np.ndarray:
    """Log-likelihoods of anchors of which one explains the strain and the others do not."""
    return np.where(np.arange(places) == 1, log_likelihood, -20.0)


ONE_PLACE = np.exp(at_one_place(0.0)) / np.exp(at_one_place(0.0)).sum()
log_likelihood = st.floats(-1e4, 1e4) | st.just(IMPOSSIBLE)


@given(st.lists(st.tuples(log_likelihood, log_likelihood, st.floats(0, 10), st.floats(0, 1)), max_size=20))
def test_probabilities_always_sum_to_one(steps: list[tuple[float, ...]]) -> None:
    explanations, rng = Explanations.start(PLACES), np.random.default_rng(0)
    for elsewhere, other, travel, left in steps:
        explanations = explanations.predict(travel, left, rng.random(PLACES) < 0.2)
        explanations = explanations.update(travel, at_one_place(elsewhere), other)
        assert sum(explanations[:3]) == pytest.approx(1.0)
        assert explanations.anchor_weights.sum() == pytest.approx(1.0)
        assert 0.0 <= explanations.injected <= 1.0


def test_what_moves_beyond_the_bounds_is_on_other_material() -> None:
    moved = Explanations.start(PLACES).predict(0.0, 0.4, NONE)
    assert moved[:3] == pytest.approx((0.3, 0.0, 0.7))


def test_an_anchor_that_moves_beyond_the_bounds_is_on_other_material_and_begins_anew() -> None:
    """Not at the opposite bound, where it reappears."""
    lost = np.arange(PLACES) == 1
    moved = Explanations(0.7, 0.2, 0.1, ONE_PLACE).predict(0.0, 0.0, lost)
    assert moved.other == pytest.approx(0.3, abs=1e-6)
    assert moved.relocated == pytest.approx(0.0, abs=1e-6)
    assert moved.tracked == pytest.approx(0.7)


def test_anchors_of_which_none_is_left_are_equally_probable() -> None:
    explanations = Explanations(0.5, 0.3, 0.2, np.eye(PLACES)[1]).predict(0.0, 0.0, np.arange(PLACES) == 1)
    assert explanations[:3] == pytest.approx((0.5, 0.0, 0.5))
    np.testing.assert_allclose(explanations.anchor_weights, 1.0 / PLACES)


def relocated(nats: float, places: int = PLACES, travel: float = 0.05) -> tuple[Explanations, float]:
    """Explanations once a place that is better by ``nats`` at every update takes over, and the travel."""
    explanations = Explanations.start(places)
    for n in range(round(travel / PITCH)):
        explanations = explanations.predict(PITCH, 0.0, np.zeros(places, dtype=bool)).update(
            PITCH, at_one_place(nats, places), -5.0
        )
        if explanations.injected:
            return explanations, (n + 1) * PITCH
    return explanations, math.inf


def test_what_was_placed_at_the_anchors_is_what_came_to_them() -> None:
    explanations, travel = Explanations(0.6, 0.1, 0.3, ONE_PLACE), 0.002
    moved = explanations.predict(travel, 0.0, NONE)
    came = (1.0 - math.exp(-RELOCATION_RATE * travel)) * (1.0 - explanations.relocated)
    assert moved.relocated * (moved.anchor_weights @ moved.placed) == pytest.approx(came, rel=1e-3)
    assert moved.placed[1] < 0.01 < 0.99 < moved.placed[0], "no hand was there before"
    np.testing.assert_array_equal(explanations.predict(0.0, 0.0, NONE).placed, 0.0)


def test_a_relocated_hand_takes_over_once_another_place_explains_more() -> None:
    explanations, _ = relocated(2.0)
    assert explanations.relocated > explanations.tracked
    assert Explanations(0.31, 0.3, 0.39, explanations.anchor_weights).injected == 0.0
    assert explanations.anchor_weights.argmax() == 1
    assert explanations.injected == pytest.approx(explanations.relocated / explanations.on_map)
    moved = explanations.predict(0.0, 0.0, NONE)
    assert moved.relocated == 0.0
    assert moved.tracked == pytest.approx(explanations.on_map, abs=1e-9)


def test_another_place_gains_on_other_material_that_explains_less() -> None:
    before = Explanations(0.02, 0.08, 0.9, ONE_PLACE)
    after = before.update(PITCH, at_one_place(4.0), 2.0)
    assert after.relocated / after.other > before.relocated / before.other


@pytest.mark.parametrize("places", [4, 200, 1600])
@pytest.mark.parametrize("nats", [20.0, 1e3, 1e9])
def test_it_takes_a_centimetre_however_much_better_the_other_place_is(nats: float, places: int) -> None:
    """What a finger brushes over is no reason to give a place up."""
    _, travel = relocated(nats, places)
    assert RELOCATION_DISTANCE <= travel <= 1.3 * RELOCATION_DISTANCE


def test_of_a_place_near_the_estimate_no_hand_is_relocated() -> None:
    explanations = Explanations.start(PLACES).predict(0.01, 0.0, NONE)
    near = np.full(PLACES, IMPOSSIBLE)
    assert explanations.update(0.01, near, IMPOSSIBLE).relocated == 0.0
    assert explanations.update(0.02, at_one_place(50.0), IMPOSSIBLE).relocated > 0.99


def test_other_material_takes_over_where_it_explains_more_and_gives_way() -> None:
    explanations, nowhere = Explanations(0.98, 0.01, 0.01, ONE_PLACE), at_one_place(-20.0)
    left = explanations.update(PITCH, nowhere, 10.0)
    assert left.other > 0.99
    assert left.predict(0.3, 0.0, NONE).other < 0.5, "patches of other material are some 0.3 m long"
    assert left.update(PITCH, nowhere, -15.0).tracked > 0.95
