"""What the localizer gives to its filter and to its model at each measurement update.

Both are made by hand here, answer with numbers that are easily recognized, and record what they are given.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support.models import noise_model

from tactile_localizer.core.filters.base import Prediction
from tactile_localizer.core.filters.belief import Belief
from tactile_localizer.core.geometry.anchors import Anchors, Injection
from tactile_localizer.core.hypotheses.convergence import Convergence, ConvergenceCriteria
from tactile_localizer.core.hypotheses.explanations import Explanations
from tactile_localizer.core.likelihood.drift import Innovation, Trend
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.other_material import ENERGY_LENGTH
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.scan.range import ScanRange
from tactile_localizer.scene import Axis, Phalanx, Scene

LINE = Scene(
    "line", (Axis("x", 0.0, 0.1, 0.003),), (Phalanx("index", (0.0,), 2), Phalanx("thumb", (0.0,), 2))
)
LAYOUT, STEP, LENGTH = LINE.layout, 0.001, 0.004
STATES = np.array([[0.02], [0.05], [0.08]])
QUIET = np.array([1.0, 2.0])
FAR = math.log(1e9)


class FilterByHand:
    """Three hypotheses, whose ancestors and weights the test sets."""

    def __init__(self) -> None:
        self.ancestors, self.continued, self.left = np.arange(3), np.ones(3), 0.0
        self.prior = np.array([0.5, 0.3, 0.2])
        self.predicted: list[tuple[np.ndarray, float, Injection | None]] = []
        self.likelihoods: list[np.ndarray] = []

    def reset(self) -> None:
        """Nothing to forget."""

    def predict(self, displacement: np.ndarray, travel: float, injection: Injection | None) -> Prediction:
        self.predicted.append((displacement, travel, injection))
        return Prediction(STATES, self.prior, self.ancestors, self.continued, self.left)

    def update(self, log_likelihood: np.ndarray) -> Belief:
        self.likelihoods.append(log_likelihood)
        return Belief(STATES[0], 1e-6 * np.eye(1), 2.5, 3)

    def weights(self) -> np.ndarray:
        return np.array([0.7, 0.2, 0.1])


class ModelByHand:
    """Records its arguments by method; ``energy``, ``at_anchors`` and ``other_log`` are set by the test."""

    def __init__(self, record: dict[str, list[Any]] | None = None) -> None:
        self.record = record if record is not None else {}
        self.noise, self.material = noise_model(LAYOUT), Material(1.0)
        self.excess = np.zeros(4)
        self.energy, self.other_log, self.at_anchors = np.array([1.0, 2.0]), 0.0, 0.0
        self.drift = SimpleNamespace(start=self._start)
        self.other = SimpleNamespace(start=lambda: np.zeros((7, 2)), energy=self._energy, update=self._other)

    def given(self, name: str) -> Any:
        """What a method was given last."""
        return self.record[name][-1]

    def _note(self, name: str, *values: Any) -> None:
        self.record.setdefault(name, []).append(values)

    def _start(self, count: int) -> Trend:
        """The trend of each trajectory is its number."""
        numbered = np.arange(count, dtype=np.float32)[:, None] + np.zeros((1, 4), dtype=np.float32)
        return Trend(0.0, np.zeros(4), np.zeros(4), numbered, -numbered)

    def _energy(self, innovation: np.ndarray, level_variance: np.ndarray) -> np.ndarray:
        self._note("energy", innovation, level_variance)
        return self.energy

    def _other(self, *given: Any) -> tuple[float, np.ndarray]:
        self._note("other", *given)
        return self.other_log, given[0] + 1.0

    def with_noise(self, excess: np.ndarray) -> ModelByHand:
        self._note("with_noise", self, excess)
        model = ModelByHand(self.record)
        model.excess = excess
        model.noise = noise_model(LAYOUT, 2.0)
        return model

    def map_at(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self._note("map_at", self, places.copy())
        return np.arange(len(places)), np.zeros((len(places), 4), dtype=np.float32)

    def innovation(self, trend: Trend, *given: Any) -> tuple[Innovation, Trend]:
        self._note("innovation", trend, *given)
        map_trend = np.zeros((len(given[1]), 4), dtype=np.float32)
        return Innovation(np.full(4, 0.5), map_trend, np.full(4, 0.25)), trend._replace(measurements=7.0)

    def off_map(self, innovation: Innovation) -> tuple[np.ndarray, np.ndarray]:
        return innovation.of_strain + 1.0, np.array([0.1, 0.2])

    def on_map(self, *given: Any) -> np.ndarray:
        self._note("on_map", *given)
        nodes, states = given[:2]
        return np.concatenate([[-1.0, -2.0, -3.0], np.full(len(nodes) - states, self.at_anchors)])


def localizer(still: float = np.inf) -> Localizer:
    wide = ScanRange(LAYOUT, np.full(4, -1e6), np.full(4, 1e6), np.ones(1))
    return Localizer(
        LINE,
        FilterByHand(),
        ModelByHand(),
        None,
        Convergence(ConvergenceCriteria(np.array([0.0075]))),
        STEP,
        LENGTH,
        np.array([1e-4]),
        QUIET,
        Anchors(LINE),
        wide,
        np.full(4, still),
    )


def move(of: Localizer, steps: int = 1, strain: np.ndarray | None = None, step: float = STEP) -> Any:
    """Move by ``steps`` update distances; returns the last estimate."""
    for _ in range(steps):
        of.moved = getattr(of, "moved", -1) + 1
        felt = np.array([0.1, 0.2, 0.3, 0.4]) + 1e-6 * (of.moved % 7) if strain is None else strain
        estimate = of.update(20_000_000 * (1 + of.moved), np.array([0.01 + step * of.moved]), felt)
        assert estimate.updated
    return estimate


def test_one_noise_factor_of_the_sweep_counts_on_the_map_and_off_it() -> None:
    """Energy is averaged over a feature's length, from its usual value on; less noise than usual is usual."""
    of = localizer()
    of.model.energy = np.array([21.0, 0.5])
    move(of)
    mean = QUIET + STEP / ENERGY_LENGTH * (of.model.energy - QUIET)
    for _ in range(3):
        expected = np.maximum(mean / QUIET, 1.0)
        assert expected[0] > 1.0
        np.testing.assert_allclose(of.model.given("on_map")[3], expected)
        np.testing.assert_allclose(of.model.given("other")[3], expected)
        mean = mean + STEP / ENERGY_LENGTH * (of.model.energy - mean)
        move(of)


def test_all_parts_of_an_update_have_its_exponent_and_travel() -> None:
    of = localizer()
    move(of, 2)
    exponent = STEP / LENGTH
    assert of.model.given("innovation")[-2:] == pytest.approx((STEP, exponent))
    assert of.model.given("other")[-2:] == pytest.approx((STEP, exponent))
    np.testing.assert_allclose(of.filter.likelihoods[-1], exponent * np.array([-1.0, -2.0, -3.0]))
    assert of.filter.predicted[-1][1] == pytest.approx(STEP)


def test_a_long_step_is_worth_no_more_than_an_independent_measurement() -> None:
    of = localizer()
    move(of, 2, step=5.0 * LENGTH)
    np.testing.assert_allclose(of.filter.likelihoods[-1], [-1.0, -2.0, -3.0])


def test_what_is_felt_off_the_map_is_the_innovation_with_its_level() -> None:
    of = localizer()
    move(of, 2)
    for given in (of.model.given("energy"), of.model.given("other")[1:3]):
        np.testing.assert_allclose(given[0], 1.5)
        np.testing.assert_allclose(given[1], [0.1, 0.2])
    np.testing.assert_allclose(of.model.given("other")[0], 1.0)  # as the update before it left them


def test_the_trend_goes_on_from_one_update_to_the_next() -> None:
    of = localizer()
    move(of, 2)
    assert of.model.given("innovation")[0].measurements == 7.0


def test_trajectories_follow_their_ancestors_and_those_of_the_anchors_stay() -> None:
    of = localizer()
    move(of)
    anchors = len(of._anchors)
    of.filter.ancestors = np.array([2, 2, 0])
    before = of.model.given("innovation")[0].map_level[:, 0]
    move(of)
    after = of.model.given("innovation")[0].map_level[:, 0]
    np.testing.assert_array_equal(before, [0, 1, 2, *range(1, anchors + 1)])
    np.testing.assert_array_equal(after, [2, 2, 0, *range(1, anchors + 1)])


def test_what_is_new_of_a_state_begins_from_the_trajectory_of_its_anchor() -> None:
    of = localizer()
    of.filter.ancestors, of.filter.continued = np.zeros(3, dtype=int), np.array([1.0, 0.25, 0.0])
    move(of)
    found = of.model.given("innovation")[0].map_level[:, 0]
    boxes = 1 + of._anchors.index(STATES)  # behind the one trajectory before the first update
    assert found[0] == 0.0
    np.testing.assert_allclose(found[1:3], np.array([0.75, 1.0]) * boxes[1:])


def test_anchors_move_with_the_palm() -> None:
    of = localizer()
    move(of)
    first = of.model.given("map_at")[1]
    move(of)
    second = of.model.given("map_at")[1]
    np.testing.assert_array_equal(first[:3], STATES)
    turns = (second[3:] - first[3:] - STEP) / LINE.extent
    np.testing.assert_allclose(turns, np.rint(turns), atol=1e-9)
    assert np.abs(second[3:] - first[3:]).max() > 0.0


def test_what_left_the_scene_counts_as_other_material() -> None:
    of = localizer()
    move(of)
    expected = of.explanations.predict(STEP, 0.6)
    of.filter.left = 0.6
    move(of)
    tracked = np.log(of.filter.prior @ np.exp(-STEP / LENGTH * np.arange(1, 4)))
    odds = math.log(of.explanations.other / of.explanations.tracked)
    assert odds == pytest.approx(math.log(expected.other / expected.tracked) - tracked, abs=1e-6)


def test_the_filter_takes_in_the_belief_of_a_relocated_hand_only_where_that_is_the_likelier() -> None:
    of = localizer()
    move(of)
    assert of.filter.predicted[-1][2] is None
    weights = np.zeros(len(of._anchors))
    weights[[3, 4]] = 0.25, 0.75
    of._sweep = of._sweep._replace(explanations=Explanations(0.1, 0.6, 0.3, weights))
    move(of)
    injection = of.filter.predicted[-1][2]
    assert injection.fraction == pytest.approx(0.6 / 0.7)
    np.testing.assert_allclose(injection.weights, weights)
    assert injection.anchors is of._anchors


def test_after_an_injection_trajectories_are_mixed_even_where_no_ancestor_changed() -> None:
    of = localizer()
    move(of)
    weights = np.full(len(of._anchors), -math.log(len(of._anchors)))
    of._sweep = of._sweep._replace(explanations=Explanations(0.1, 0.6, 0.3, weights))
    of.filter.continued = np.array([1.0, 1.0, 0.0])
    before = of.model.given("innovation")[0].map_level[:, 0]
    move(of)
    after = of.model.given("innovation")[0].map_level[:, 0]
    assert after[2] == before[3 + of._anchors.index(STATES[2:])[0]]


def test_the_sweep_is_whitened_anew_where_its_noise_has_changed_and_not_otherwise() -> None:
    """From the scan's model, not from the last one; and both densities are then in the new volume."""
    of, rng = localizer(), np.random.default_rng(0)
    quiet = move(of, 5)
    assert "with_noise" not in of.model.record
    for _ in range(40):
        noisy = move(of, strain=np.array([30.0, 1.0, 1.0, 1.0]) * rng.standard_normal(4))
    made = of.model.record["with_noise"]
    assert all(model is of.model for model, _ in made)
    assert made[-1][1][0] > 30.0
    assert len(made) < 40, "a fifth more or less is no change"
    used = of.model.given("map_at")[0]
    np.testing.assert_array_equal(used.excess, made[-1][1])
    assert noisy.log_other - quiet.log_other == pytest.approx(-4.0 * math.log(2.0))


@pytest.mark.parametrize("strains", [1, 4])
def test_the_noise_of_a_mean_is_that_of_a_strain_over_their_number(strains: int) -> None:
    of, rng = localizer(), np.random.default_rng(0)
    for n in range(200):
        of.update(20_000_000 * n, np.array([n * STEP / strains]), 30.0 * rng.standard_normal(4))
    assert of.model.given("map_at")[0].excess.mean() == pytest.approx(900.0 / strains, rel=0.4)


def test_a_gauge_that_stands_still_is_all_noise_and_its_phalanx_counts_by_the_others() -> None:
    of, rng = localizer(still=0.0), np.random.default_rng(0)
    for _ in range(6):
        strain = 0.1 * rng.standard_normal(4)
        strain[1] = 0.05
        move(of, strain=strain)
    assert len(of.model.record["with_noise"]) == 1, "it is still all noise"
    excess = of.model.given("map_at")[0].excess
    assert excess[1] >= 1e9
    assert excess[[0, 2, 3]].max() < 1.0
    assert of.model.given("on_map")[4].tolist() == [True, True]
    assert of.model.given("other")[4].tolist() == [True, True]


def test_an_absent_phalanx_does_not_count() -> None:
    of = localizer()
    move(of)
    of.update(10**9, np.array([0.02]), np.full(4, 0.1), np.array([False, True]))
    assert of.model.given("on_map")[4].tolist() == [False, True]
    assert of.model.given("other")[4].tolist() == [False, True]


def test_only_anchors_far_from_the_estimate_are_another_place() -> None:
    of = localizer()
    of.model.at_anchors = FAR
    move(of)
    near = np.abs(of._anchors.states[:, 0] - STATES[0, 0]) <= 0.01
    weights = of.explanations.anchor_weights
    assert near.any()
    assert not weights[near].any()
    assert weights[~near].min() > 0.0
