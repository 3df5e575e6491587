"""Converged: the probability of being near the estimate, held over a distance."""

import numpy as np
import pytest

from tactile_localizer.core.hypotheses.convergence import (
    Convergence,
    ConvergenceCriteria,
    Ellipsoid,
    State,
)

CRITERIA = ConvergenceCriteria(np.array([0.005]), probability=0.99, sustain=0.002)


HOLDS, FAR = (1.0, 0.999, 0.0), (0.1, 0.9, 0.0)
"""Probabilities of being near the estimate, on the map, and on unknown material."""


def after(*updates: tuple[float, float, float], travel: float = 0.001) -> Convergence:
    """After updates with (near, on map, unknown), each ``travel`` metres on."""
    convergence = Convergence(CRITERIA)
    for near, on_map, unknown in updates:
        convergence.update(near, on_map, unknown, travel)
    return convergence


@pytest.mark.parametrize(
    ("updates", "state", "reason"),
    [
        ([HOLDS] * 2, State.SEARCHING, "not converged: held over 1.0 of 2.0 mm"),
        ([HOLDS] * 3, State.CONVERGED, "converged: probability 0.999"),
        ([*[HOLDS] * 2, FAR, *[HOLDS] * 2], State.SEARCHING, "not converged: held over 1.0"),
        ([*[HOLDS] * 3, (1.0, 0.52, 0.48)], State.CONVERGED, "converged: probability 0.520, kept"),
        ([*[HOLDS] * 3, (1.0, 0.48, 0.52)], State.LOST, "lost: the map explains what is felt"),
        ([*[HOLDS] * 3, FAR, FAR], State.LOST, "lost: the position is within the radius"),
        ([*[HOLDS] * 3, FAR, *[HOLDS] * 2], State.SEARCHING, "not converged: held over 1.0"),
        ([*[HOLDS] * 3, FAR, *[HOLDS] * 3], State.CONVERGED, "converged"),
        ([FAR], State.SEARCHING, "not converged: the position is within the radius with probability 0.10"),
        ([(1.0, 0.7, 0.2)], State.SEARCHING, "not converged: the map explains what is felt with probability"),
        ([(1.0, 0.02, 0.98)], State.SEARCHING, "not converged: the map explains what is felt with"),
        ([(1.0, 0.005, 0.995)], State.UNKNOWN, "unknown material: the map explains what is felt with"),
        ([(1.0, 0.01, 0.5)], State.SEARCHING, "not converged"),  # featureless material is not unknown
    ],
)
def test_a_probability_held_over_the_distance_is_converged_until_it_is_improbable(
    updates: list[tuple[float, float, float]], state: State, reason: str
) -> None:
    found = after(*updates)
    assert found.state is state
    assert found.reason.startswith(reason)


def test_a_hand_at_rest_does_not_converge() -> None:
    assert after(*[HOLDS] * 1000, travel=0.0).state is State.SEARCHING


def test_a_reset_forgets() -> None:
    convergence = after(*[HOLDS] * 3)
    convergence.reset()
    assert convergence.state is State.SEARCHING
    assert convergence.probability == 0.0


@pytest.mark.parametrize("dimension", [1, 2, 3])
@pytest.mark.parametrize("std", [1e-4, 0.002, 0.004])
def test_the_probability_includes_the_registration_error(dimension: int, std: float) -> None:
    rng = np.random.default_rng(dimension)
    away = np.concatenate([rng.normal(0.0, 0.001, (60, dimension)), rng.normal(0.03, 0.001, (20, dimension))])
    weights, radius = rng.dirichlet(np.ones(len(away))), np.full(dimension, 0.0075)
    moved = away[:, None] + std * rng.standard_normal((4000, dimension))
    inside = (np.square(moved / radius).sum(axis=-1) <= 1.0).mean(axis=1)
    found = Ellipsoid(radius, np.full(dimension, std**2)).probability(away, weights)
    assert found == pytest.approx(weights @ inside, abs=0.01)


@pytest.mark.parametrize(("beyond", "expected"), [(1.0, 0.1587), (2.0, 0.02275), (2.5, 0.0062)])
def test_a_state_some_deviations_outside_of_the_radius_counts_in_part(beyond: float, expected: float) -> None:
    away = np.array([[0.0075 + beyond * 0.001]])
    found = Ellipsoid(np.array([0.0075]), np.array([0.001**2])).probability(away, np.ones(1))
    assert found == pytest.approx(expected, abs=0.003)
