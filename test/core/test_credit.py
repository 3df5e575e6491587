"""Featureless strains speak neither for nor against a place where the map too felt nothing."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tactile_localizer.core.credit import NO_CREDIT, Credit

FINITE = st.floats(-1e6, 1e6)
OFF = np.array([True, False, False])


def test_off_the_feature_a_featureless_strain_is_explained_as_such() -> None:
    assert Credit(60.0, 45.0).earned(np.array([40.0, 20.0, 20.0]), OFF)[0] == 60.0


def test_on_the_feature_the_map_is_lifted_by_its_blur_where_it_felt_nothing_and_no_higher() -> None:
    earned = Credit(60.0, 45.0).earned(np.array([45.0, 46.0, 44.0]), OFF)
    assert earned.tolist() == [60.0, 60.0, 59.0]


def test_a_place_that_expects_contact_is_still_contradicted() -> None:
    assert Credit(60.0, 45.0).earned(np.array([45.0, 20.0, 10.0]), OFF).tolist() == [60.0, 35.0, 25.0]


def test_a_strain_that_is_not_featureless_earns_nothing() -> None:
    log_likelihood = np.array([-5.0, 30.0, 20.0])
    assert np.array_equal(Credit(-80.0, -80.0).earned(log_likelihood, OFF), log_likelihood)


@given(st.lists(FINITE, min_size=3, max_size=3), FINITE, st.floats(-1e3, 1e3))
def test_credit_never_takes_and_never_gives_more_than_the_featureless_explanation(
    log_likelihood: list[float], featureless: float, lift: float
) -> None:
    before = np.array(log_likelihood)
    credit = Credit(featureless, featureless - lift)
    after = credit.earned(before, OFF)
    assert (after >= before).all()
    assert (after <= np.maximum(before, credit.best)).all()
    assert np.array_equal(NO_CREDIT.earned(before, OFF), before)
    assert NO_CREDIT.featureless == -math.inf


def test_the_best_of_the_three_explanations_is_what_a_place_has_to_surpass() -> None:
    assert Credit(60.0, 45.0, 50.0).best == 60.0
    assert Credit(40.0, 45.0, 30.0).best == 45.0
    assert Credit(40.0, 45.0, 50.0).best == 50.0
