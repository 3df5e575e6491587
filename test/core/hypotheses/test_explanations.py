"""The hidden Markov model over the explanations of a strain."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_localizer.core.hypotheses.explanations import RELOCATION_RATE, Explanations
from tactile_localizer.core.likelihood.evaluation import Likelihoods

PLACES = 20
EVERYWHERE, NOWHERE = np.ones(PLACES, bool), np.zeros(PLACES, bool)
IMPOSSIBLE = -math.inf


def likelihoods(references: float, unknown: float = -10.0, featureless: float = -10.0) -> Likelihoods:
    """Of a place of the map that is far from the estimate; the other places are improbable."""
    return Likelihoods(np.zeros(1), np.where(np.arange(PLACES) == 7, references, -20.0), unknown, featureless)


log_likelihood = st.floats(-1e4, 1e4) | st.just(IMPOSSIBLE)


@given(
    st.booleans(),
    st.lists(
        st.tuples(*[log_likelihood] * 4, st.floats(0, 10), st.floats(0, 1), st.floats(0.01, 1)), max_size=20
    ),
)
def test_probabilities_always_sum_to_one(only_map: bool, steps: list[tuple[float, ...]]) -> None:
    explanations = Explanations.start(PLACES, only_map)
    for tracked, references, unknown, featureless, travel, left, exponent in steps:
        explanations = explanations.predict(travel, left)
        felt = likelihoods(references, unknown, featureless)
        explanations = explanations.update(tracked, felt, EVERYWHERE, exponent)
        assert sum(explanations[:4]) == pytest.approx(1.0)
        assert np.exp(explanations.elsewhere).sum() == pytest.approx(1.0)
        assert 0.0 <= explanations.taken_in <= 1.0


def test_where_the_map_alone_explains_no_hand_leaves_it() -> None:
    moved = Explanations.start(PLACES, only_map=True).predict(0.3, 0.5)
    assert moved.on_map == 1.0
    assert moved.relocated == pytest.approx(-math.expm1(-RELOCATION_RATE * 0.3))


def test_what_moves_beyond_the_bounds_is_on_unknown_or_featureless_material() -> None:
    moved = Explanations.start(PLACES, only_map=False).predict(0.0, 0.4)
    assert moved[:4] == pytest.approx((0.3, 0.0, 0.35, 0.35))


def test_a_relocated_hand_takes_over_once_another_place_explains_more() -> None:
    explanations = Explanations.start(PLACES, only_map=False)
    for _ in range(20):
        explanations = explanations.predict(0.0005, 0.0).update(-10.0, likelihoods(-2.0), EVERYWHERE, 1.0)
        if explanations.taken_in:
            break
    assert explanations.relocated > 0.5 * explanations.tracked
    assert explanations.elsewhere.argmax() == 7
    assert explanations.taken_in == pytest.approx(explanations.relocated / explanations.on_map)
    moved = explanations.predict(0.0, 0.0)
    assert moved.relocated == 0.0
    assert moved.tracked == pytest.approx(explanations.on_map)


def test_of_a_place_near_the_estimate_no_hand_is_relocated() -> None:
    explanations = Explanations.start(PLACES, only_map=False).predict(0.01, 0.0)
    assert explanations.update(0.0, likelihoods(50.0), NOWHERE, 1.0).relocated == 0.0
    assert explanations.update(0.0, likelihoods(50.0), EVERYWHERE, 1.0).relocated > 0.99


def test_nothing_is_learned_when_all_is_impossible() -> None:
    explanations = Explanations.start(PLACES, only_map=False).predict(0.01, 0.0)
    impossible = Likelihoods(np.zeros(1), np.full(PLACES, IMPOSSIBLE), IMPOSSIBLE, IMPOSSIBLE)
    assert explanations.update(IMPOSSIBLE, impossible, EVERYWHERE, 1.0) is explanations
