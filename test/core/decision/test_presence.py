"""A filter over {on a map, unknown material, featureless material off the maps}."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_localizer.core.decision.presence import LEAVING_RATE, Presence
from tactile_localizer.core.decision.relocation import relocation_probability

FOR_MAP, FOR_UNKNOWN, FOR_FEATURELESS = 20.0 * np.eye(3)


def total(presence: Presence) -> float:
    """Sum of all probabilities."""
    return presence.probability + presence.unknown + presence.featureless


def test_at_first_the_map_is_as_probable_as_not() -> None:
    assert Presence().probability == pytest.approx(0.5)
    assert Presence([1 / 3] * 3).maps == pytest.approx([1 / 6] * 3)


@pytest.mark.parametrize(
    ("evidence", "on_map", "unknown"),
    [(FOR_MAP, 1.0, 0.0), (FOR_UNKNOWN, 0.03, 0.97), (FOR_FEATURELESS, 0.03, 0.0)],
    ids=["map", "unknown", "featureless"],
)
def test_evidence_decides_between_the_three_states(
    evidence: np.ndarray, on_map: float, unknown: float
) -> None:
    presence = Presence()
    presence.update(evidence)
    assert presence.probability == pytest.approx(on_map, abs=1e-5)
    assert presence.unknown == pytest.approx(unknown, abs=1e-5)


def test_bayes_rule_on_one_measurement() -> None:
    presence = Presence()
    presence.update(np.log([0.2, 0.1, 0.4]))
    weights = np.array([0.5 * 0.2, 0.25 * 0.1, 0.25 * 0.4])
    assert presence.probability == pytest.approx(weights[0] / weights.sum())
    assert presence.unknown == pytest.approx(weights[1] / weights.sum())


def test_what_rides_off_the_scene_goes_elsewhere() -> None:
    presence = Presence()
    presence.update(FOR_MAP)
    on_map = presence.probability
    presence.predict(0.0, 0.3)
    assert presence.probability == pytest.approx(0.7 * on_map)
    assert presence.unknown == pytest.approx(0.15, abs=1e-3)
    assert total(presence) == pytest.approx(1.0)


def test_of_several_maps_each_loses_what_rides_off_its_own() -> None:
    presence = Presence([0.5, 0.5])
    presence.predict(0.0, [0.0, 0.4])
    assert presence.maps == pytest.approx([0.25, 0.15])
    assert total(presence) == pytest.approx(1.0)


def test_without_travel_and_loss_nothing_changes() -> None:
    presence = Presence()
    presence.update(np.log([0.2, 0.1, 0.4]))
    before = presence.probability
    presence.predict(0.0, 0.0)
    assert presence.probability == pytest.approx(before)


def test_a_hand_that_left_returns_with_the_travel() -> None:
    presence = Presence()
    presence.predict(0.0, 1.0)
    assert presence.probability == 0.0
    presence.predict(0.01, 0.0)
    assert presence.probability == pytest.approx(relocation_probability(0.01), rel=0.01)


def test_travel_in_one_step_or_in_many_is_the_same() -> None:
    one, many = Presence(), Presence()
    one.predict(0.01, 0.0)
    for _ in range(100):
        many.predict(0.0001, 0.0)
    assert one.probability == pytest.approx(many.probability, rel=1e-3)


def test_the_map_is_left_as_often_as_the_rate_says() -> None:
    presence = Presence()
    presence.update(FOR_MAP)
    presence.predict(0.001, 0.0)
    assert 1.0 - presence.probability == pytest.approx(0.001 * LEAVING_RATE, rel=0.1)


def test_what_is_a_million_times_as_probable_can_still_be_contradicted() -> None:
    presence = Presence()
    for _ in range(1000):
        presence.update(FOR_MAP)
    for _ in range(2):
        presence.update(FOR_UNKNOWN)
    assert presence.unknown == pytest.approx(0.97, abs=1e-3)


def test_a_map_that_was_contradicted_for_long_is_as_soon_found_again() -> None:
    presence = Presence([0.5, 0.5])
    presence.update(np.array([1.0, 0.0, 0.0, 0.0]))
    share = presence.maps / presence.probability
    for _ in range(1000):
        presence.update(np.array([0.0, 0.0, 3.0, 0.0]))
    assert presence.maps == pytest.approx(0.03 * share)


def test_material_without_featureless_places_is_never_featureless() -> None:
    presence = Presence()
    presence.update(np.array([0.0, 0.0, -np.inf]))
    assert presence.probability + presence.unknown == pytest.approx(1.0, abs=1e-5)


@given(
    st.integers(1, 4),
    st.lists(
        st.tuples(
            st.lists(st.floats(-1e6, 1e6), min_size=6, max_size=6), st.floats(0.0, 1.0), st.floats(0.0, 1.0)
        ),
        max_size=20,
    ),
)
def test_whatever_happens_the_probabilities_sum_to_one(maps, steps) -> None:
    presence = Presence([1.0 / maps] * maps)
    for evidence, travel, left in steps:
        presence.predict(travel, left)
        presence.update(np.array(evidence[: maps + 2]))
        assert total(presence) == pytest.approx(1.0)
        assert (presence.maps >= 0.0).all()
