"""Converged: the probability of being near the estimate, held over a distance."""

import numpy as np
import pytest

from tactile_localizer.core.hypotheses.convergence import (
    Convergence,
    ConvergenceCriteria,
    State,
    probability_within,
)

CRITERIA = ConvergenceCriteria(np.array([0.005]), probability=0.99, sustain=0.002)


def after(*updates: tuple[float, float, float], travel: float = 0.001) -> Convergence:
    """After updates with (near, on map, unknown), each ``travel`` metres on."""
    convergence = Convergence(CRITERIA)
    for near, on_map, unknown in updates:
        convergence.update(near, on_map, unknown, travel)
    return convergence


HOLDS = (1.0, 0.999, 0.0)


def test_a_probability_held_over_the_distance_is_converged() -> None:
    assert after(*[HOLDS] * 1000, travel=0.0).state is State.SEARCHING, "a hand at rest"
    assert after(HOLDS).state is State.SEARCHING
    assert after(HOLDS).reason == "not converged: held over 1.0 of 2.0 mm"
    assert after(HOLDS, HOLDS).state is State.CONVERGED
    assert after(HOLDS, HOLDS).reason == "converged: probability 0.999"


def test_an_interruption_begins_the_distance_anew() -> None:
    assert after(HOLDS, (0.5, 1.0, 0.0), HOLDS).state is State.SEARCHING


@pytest.mark.parametrize(
    ("update", "reason"),
    [
        ((0.6, 1.0, 0.0), "not converged: the position is within the radius with probability 0.60"),
        ((1.0, 0.7, 0.2), "not converged: the map explains what is felt with probability 0.70"),
        ((1.0, 0.02, 0.98), "unknown material: the map explains what is felt with probability 0.02"),
    ],
)
def test_the_reason_names_the_factor_that_fails(update: tuple[float, float, float], reason: str) -> None:
    assert after(update).reason == reason


def test_a_converged_position_is_kept_until_it_is_improbable() -> None:
    assert after(HOLDS, HOLDS, (1.0, 0.92, 0.08)).state is State.CONVERGED
    lost = after(HOLDS, HOLDS, (1.0, 0.88, 0.12))
    assert lost.state is State.LOST
    assert lost.reason.startswith("lost: the map explains")


def test_what_was_lost_can_be_found_again() -> None:
    assert after(HOLDS, HOLDS, (0.1, 0.9, 0.0), (0.1, 0.9, 0.0)).state is State.LOST
    assert after(HOLDS, HOLDS, (0.1, 0.9, 0.0), HOLDS).state is State.SEARCHING
    assert after(HOLDS, HOLDS, (0.1, 0.9, 0.0), HOLDS, HOLDS).state is State.CONVERGED


def test_unknown_material_is_a_state_of_its_own() -> None:
    assert after((1.0, 0.01, 0.96)).state is State.UNKNOWN
    assert after((1.0, 0.01, 0.5)).state is State.SEARCHING, "featureless material is not unknown"


def test_a_reset_forgets() -> None:
    convergence = after(HOLDS, HOLDS)
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
    found = probability_within(away, weights, radius, np.full(dimension, std**2))
    assert found == pytest.approx(weights @ inside, abs=0.01)
