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
from tactile_localizer.core.geometry.anchors import Anchors
from tactile_localizer.core.hypotheses.convergence import Convergence, ConvergenceCriteria
from tactile_localizer.core.hypotheses.explanations import Explanations
from tactile_localizer.core.likelihood.ancestry import Ancestry
from tactile_localizer.core.likelihood.drift import Innovation, Trend
from tactile_localizer.core.likelihood.gain import RECENT, Gain
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.on_map import OnMap, Places
from tactile_localizer.core.likelihood.scatter import Whitening
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.measurements import Measurements
from tactile_localizer.core.scan.range import ScanRange
from tactile_localizer.core.weights import bayes
from tactile_localizer.scene import Axis, Phalanx, Scene

LINE = Scene(
    "line", (Axis("x", 0.0, 0.1, 0.003),), (Phalanx("index", (0.0,), 2), Phalanx("thumb", (0.0,), 2))
)
LAYOUT, STEP, LENGTH, POSITION_LENGTH = LINE.layout, 0.001, 0.004, 0.002
STATES = np.array([[0.02], [0.05], [0.08]])
ON_MAP, SCATTERED = np.array([-1.0, -2.0, -3.0]), np.array([-4.0, -6.0, -8.0])
"""Log-likelihoods of the states as the scan expects strains, and with a covariance of the sweep's own."""
FAR = math.log(1e9)
WITHIN = np.kron(np.eye(2), np.ones((2, 2)))
"""Blocks of the phalanges."""


class FilterByHand:
    """Three hypotheses, whose ancestors and weights the test sets; at first they have one."""

    def __init__(self) -> None:
        self.has_begun = False
        self.ancestors, self.continued, self.left = np.arange(3), np.ones(3), 0.0
        self.prior = np.array([0.5, 0.3, 0.2])
        self.predicted: list[tuple[np.ndarray, float, float]] = []
        self.likelihoods: list[np.ndarray] = []

    def reset(self) -> None:
        self.has_begun = False

    def predict(self, displacement: np.ndarray, travel: float, injected: float) -> Prediction:
        self.predicted.append((displacement, travel, injected))
        ancestors = self.ancestors if self.has_begun else np.zeros(3, dtype=int)
        self.has_begun = True
        return Prediction(STATES, self.prior, ancestors, self.continued, self.left)

    def update(self, log_likelihood: np.ndarray) -> Belief:
        self.likelihoods.append(log_likelihood)
        return Belief(STATES[0], 1e-6 * np.eye(1), 2.5, 3)

    def weights(self) -> np.ndarray:
        return np.array([0.7, 0.2, 0.1])


class ModelByHand:
    """Records its arguments by method; the test sets the rest, of which the information is by trajectory."""

    def __init__(self, record: dict[str, list[Any]] | None = None) -> None:
        self.record = record if record is not None else {}
        self.noise, self.material = noise_model(LAYOUT), Material.SHEET
        self.excess, self.gain_variance = np.zeros((4, 4)), 0.1
        self.residuals, self.other_log, self.at_anchors = np.ones((3, 4)), 0.0, 0.0
        self.log_volume, self.is_widened = self.noise.log_volume, False
        self.drift = SimpleNamespace(start=self._start)
        self.other = SimpleNamespace(start=lambda: np.zeros((7, 2)), update=self._other)

    def given(self, name: str) -> Any:
        """What a method was given last."""
        return self.record[name][-1]

    def _note(self, name: str, *values: Any) -> None:
        self.record.setdefault(name, []).append(values)

    def _start(self, count: int) -> Trend:
        """The trend of each trajectory is its number."""
        numbered = np.arange(count, dtype=np.float32)[:, None] + np.zeros((1, 4), dtype=np.float32)
        return Trend(0.0, np.zeros(4), np.zeros(4), np.stack([numbered, -numbered]))

    def _other(self, *given: Any) -> tuple[float, np.ndarray]:
        self._note("other", *given)
        return self.other_log, given[0] + 1.0

    def is_changed(self, excess: np.ndarray) -> bool:
        return bool((np.abs(excess - self.excess) > 0.2 * (1.0 + self.excess.max())).any())

    def with_noise(self, excess: np.ndarray) -> ModelByHand:
        model = self._noisier("with_noise", excess, 2.0)
        model.excess = excess
        return model

    def with_whitening(self, whitening: Whitening) -> ModelByHand:
        model = self._noisier("with_whitening", whitening, 3.0)
        model.is_widened = True
        return model

    def _noisier(self, method: str, given: Any, width: float) -> ModelByHand:
        """With the same record, and its strains whitened by a width."""
        self._note(method, self, given)
        model = ModelByHand(self.record)
        model.noise = noise_model(LAYOUT, width)
        model.log_volume = model.noise.log_volume
        return model

    def whitening_after(self, other: ModelByHand) -> np.ndarray:
        return np.eye(4)

    def direction(self, strain: np.ndarray) -> np.ndarray:
        return np.array([1.0, 0.0, 0.0, 1.0]) * np.abs(strain)

    def felt(self, innovation: Innovation, used: np.ndarray) -> tuple[ModelByHand, np.ndarray]:
        return self, used

    def moments(self, felt: Any, places: Places, weights: np.ndarray) -> np.ndarray:
        self._note("moments", felt, weights)
        return np.einsum("p,pi,pj->ij", weights, self.residuals, self.residuals) * WITHIN

    def map_at(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self._note("map_at", self, places.copy())
        return np.arange(len(places)), np.zeros((len(places), 4), dtype=np.float32)

    def innovation(self, trend: Trend, *given: Any) -> tuple[Innovation, Trend]:
        self._note("innovation", trend, *given)
        of_map = np.zeros((len(given[1]), 4), dtype=np.float32)
        return Innovation(np.full(4, 0.5), of_map, np.full(4, 0.25)), trend._replace(measurements=7.0)

    def off_map(self, innovation: Innovation) -> tuple[np.ndarray, np.ndarray]:
        return innovation.of_strain + 1.0, np.array([0.1, 0.2])

    def on_map(self, *given: Any) -> OnMap:
        (_, used), (nodes, states, _, gain), exponent = given
        self._note("on_map", gain, used)
        information = np.ones((2, 1), np.float32) * np.arange(len(nodes), dtype=np.float32)
        return OnMap(
            (SCATTERED if self.is_widened else ON_MAP).copy(),
            np.full(len(nodes) - states, self.at_anchors),
            gain.updated(information, -0.5 * information, exponent),
        )


def localizer(still: float = np.inf) -> Localizer:
    wide = ScanRange(LAYOUT, np.full(4, -1e6), np.full(4, 1e6), np.ones(1), np.zeros(4))
    noise = noise_model(LAYOUT)
    return Localizer(
        LINE,
        FilterByHand(),
        ModelByHand(),
        None,
        Convergence(ConvergenceCriteria(np.array([0.0075]))),
        Measurements(LINE, noise.white, noise.variance, wide, np.full(4, still), STEP),
        POSITION_LENGTH,
        LENGTH,
        np.array([1e-4]),
        Anchors(LINE),
    )


def move(of: Localizer, steps: int = 1, strain: np.ndarray | None = None, step: float = STEP) -> Any:
    """Move by ``steps`` update distances; returns the last estimate."""
    for _ in range(steps):
        of.moved = getattr(of, "moved", -1) + 1
        felt = np.array([0.1, 0.2, 0.3, 0.4]) + 1e-6 * (of.moved % 7) if strain is None else strain
        estimate = of.update(20_000_000 * (1 + of.moved), np.array([0.01 + step * of.moved]), felt)
        assert estimate.updated
    return estimate


def test_the_scatter_of_a_sweep_is_that_of_its_recent_residuals_where_it_may_be() -> None:
    """Of a whole measurement; at first over all of them, then over a feature's length."""
    of, moments, (fitting, _) = localizer(), np.eye(4), bayes(np.array([0.5, 0.3, 0.2]), ON_MAP)
    of.model.residuals = np.array([[0.3, 0.6, 0.1, 0.0], [0.2, -0.3, 0.0, 0.1], [0.0, 0.0, 0.0, 0.0]])
    for n in range(1, round(2.0 * RECENT / STEP)):
        move(of)
        mean = np.einsum("p,pi,pj->ij", fitting, of.model.residuals, of.model.residuals) * WITHIN
        moments = moments + max(STEP / RECENT, 1.0 / n) * (mean - moments)
        np.testing.assert_allclose(of._sweep.scatter.moments, moments, atol=1e-12)
        independent = min(STEP / LENGTH * RECENT / STEP, n)
        assert of._sweep.scatter.measurements == pytest.approx(independent)


def test_what_scatters_along_the_strain_is_noise_everywhere_and_else_for_the_position_alone() -> None:
    """So that a place far off, and other material, are compared with the map under the same noise."""
    for felt, on_map in (([9.0, 0.0, 0.0, 0.0], SCATTERED), ([0.0, 9.0, 0.0, 0.0], ON_MAP)):
        of = localizer()
        of.model.residuals = np.tile(felt, (3, 1))
        move(of, 30)
        of.filter.likelihoods.clear()
        estimate = move(of)
        np.testing.assert_allclose(of.filter.likelihoods[-1], STEP / POSITION_LENGTH * SCATTERED)
        volume = -4.0 * math.log(3.0) if on_map is SCATTERED else 0.0
        tracked = bayes(np.array([0.5, 0.3, 0.2]), STEP / LENGTH * on_map)[1] * LENGTH / STEP
        assert estimate.log_marginal == pytest.approx(tracked + volume)
        assert estimate.log_other == pytest.approx(volume)


def test_the_gain_of_each_trajectory_takes_in_its_own_residuals() -> None:
    of, fraction = localizer(), STEP / LENGTH
    move(of)
    start, weights = of.model.given("on_map")[0], of.filter.weights()
    information = np.arange(start.mean.shape[1], dtype=np.float32)
    of.filter.ancestors, new = np.array([2, 2, 0]), placed(of, 0.2)
    move(of)
    updated = start.updated(information, -0.5 * information, fraction)
    expected = updated.followed(Ancestry(np.array([2, 2, 0]), np.ones(3), new, weights)).predicted(STEP, 0.1)
    np.testing.assert_allclose(of.model.given("on_map")[0].moments, expected.moments, rtol=1e-5)
    begun = Gain.start(2, len(information), 0.1)
    np.testing.assert_allclose(start.variance, begun.variance)


def test_all_parts_of_an_update_have_its_exponent_and_travel() -> None:
    of = localizer()
    move(of, 2)
    exponent = STEP / LENGTH
    *_, travel, trend_exponent, measured = of.model.given("innovation")
    assert (travel, trend_exponent) == pytest.approx((STEP, exponent))
    assert measured is None
    assert of.model.given("other")[-2:] == pytest.approx((STEP, exponent))
    np.testing.assert_allclose(of.filter.likelihoods[-1], STEP / POSITION_LENGTH * ON_MAP)
    assert of.filter.predicted[-1][1] == pytest.approx(STEP)


def test_a_long_step_is_worth_no_more_than_an_independent_measurement() -> None:
    of = localizer()
    move(of, 2, step=5.0 * LENGTH)
    np.testing.assert_allclose(of.filter.likelihoods[-1], ON_MAP)


def test_what_is_felt_off_the_map_is_the_innovation_with_its_level() -> None:
    of = localizer()
    move(of, 2)
    weights, felt, level_variance = of.model.given("other")[:3]
    np.testing.assert_allclose(weights, 1.0)  # as the update before it left them
    np.testing.assert_allclose(felt, 1.5)
    np.testing.assert_allclose(level_variance, [0.1, 0.2])


def test_the_trend_goes_on_from_one_update_to_the_next() -> None:
    of = localizer()
    move(of, 2)
    assert of.model.given("innovation")[0].measurements == 7.0


def placed(of: Localizer, relocated: float) -> np.ndarray:
    """Fraction of the weight of each anchor that the next step places there, (R,).

    Where a hand was ``relocated`` so far with this probability, to every second anchor.
    """
    weights = np.zeros(len(of._anchors))
    weights[::2] = 1.0 / len(weights[::2])
    explanations = of.explanations._replace(
        relocated=relocated, tracked=0.6 - relocated, other=0.4, anchor_weights=weights
    )
    of._explanations = explanations
    return np.asarray(explanations.predict(STEP, 0.0, np.zeros(len(weights), dtype=bool)).placed)


@pytest.mark.parametrize("already", [0.0, 0.2])
def test_trajectories_follow_their_ancestors_and_a_hand_that_is_placed_elsewhere_was_tracked(
    already: float,
) -> None:
    """Its trend is that with which it was tracked; of a hand that was there before, that of the anchor."""
    of = localizer()
    move(of)
    before = of.model.given("innovation")[0].of_map[0, :, 0]
    of.filter.ancestors, fraction = np.array([2, 2, 0]), placed(of, already)
    tracked = of.filter.weights() @ before[:3]
    move(of)
    after = of.model.given("innovation")[0].of_map[0, :, 0]
    np.testing.assert_array_equal(after[:3], before[[2, 2, 0]])
    np.testing.assert_allclose(after[3:], before[3:] + fraction * (tracked - before[3:]), rtol=1e-5)
    np.testing.assert_allclose(fraction[1::2], 1.0)
    assert np.all(fraction[::2] < 0.01) if already else np.all(fraction == 1.0)


def test_what_is_new_of_a_state_was_tracked_before() -> None:
    """Its trend and gain are those of the belief, of which it is a part."""
    of = localizer()
    move(of)
    of.filter.ancestors, of.filter.continued = np.zeros(3, dtype=int), np.array([1.0, 0.25, 0.0])
    trend, gain = of.model.given("innovation")[0], of._sweep.gain
    move(of)
    found = of.model.given("innovation")[0].of_map[0, :3, 0]
    mean = of.filter.weights() @ trend.of_map[0, :3, 0]
    np.testing.assert_allclose(found, trend.of_map[0, 0, 0] + np.array([0.0, 0.75, 1.0]) * mean, rtol=1e-6)
    new = of.model.given("on_map")[0].mean[:, 2:3]
    tracked = of.filter.weights() @ gain.predicted(STEP, 0.1).mean[:, :3].T
    np.testing.assert_allclose(new[:, 0], tracked, rtol=1e-6)


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
    """And whether this is the map is judged by the variance of the scan, not by that of the sweep."""
    of = localizer()
    of.model.residuals = np.tile([0.0, 9.0, 9.0, 0.0], (3, 1))
    move(of)
    expected = of.explanations.predict(STEP, 0.6, np.zeros(len(of._anchors), dtype=bool))
    of.filter.left = 0.6
    move(of)
    tracked = np.log(of.filter.prior @ np.exp(-STEP / LENGTH * np.arange(1, 4)))
    odds = math.log(of.explanations.other / of.explanations.tracked)
    assert odds == pytest.approx(math.log(expected.other / expected.tracked) - tracked, abs=1e-6)


def test_the_filter_takes_in_the_belief_of_a_relocated_hand_only_where_that_is_the_likelier() -> None:
    of = localizer()
    move(of)
    assert of.filter.predicted[-1][2] == 0.0
    weights = np.full(len(of._anchors), 1.0 / len(of._anchors))
    of._explanations = Explanations(0.1, 0.6, 0.3, weights)
    move(of)
    assert of.filter.predicted[-1][2] == pytest.approx(0.6 / 0.7)
    move(of)
    assert of.filter.predicted[-1][2] == 0.0


def test_after_an_injection_trajectories_are_mixed_even_where_no_ancestor_changed() -> None:
    of = localizer()
    move(of)
    weights = np.full(len(of._anchors), 1.0 / len(of._anchors))
    of._explanations = Explanations(0.1, 0.6, 0.3, weights)
    of.filter.continued = np.array([1.0, 1.0, 0.0])
    before = of.model.given("innovation")[0].of_map[0, :3, 0]
    move(of)
    after = of.model.given("innovation")[0].of_map[0, :3, 0]
    np.testing.assert_allclose(after, [*before[:2], of.filter.weights() @ before], rtol=1e-6)


def test_the_sweep_is_whitened_anew_where_its_noise_has_changed_and_not_otherwise() -> None:
    """From the scan's model, not from the last one; and both densities are then in the new volume."""
    of, rng = localizer(), np.random.default_rng(0)
    quiet = move(of, 5)
    assert "with_noise" not in of.model.record
    for _ in range(40):
        noisy = move(of, strain=np.array([30.0, 1.0, 1.0, 1.0]) * rng.standard_normal(4))
    made = of.model.record["with_noise"]
    assert all(model is of.model for model, _ in made)
    assert made[-1][1][0, 0] > 30.0
    assert len(made) < 40, "a fifth more or less is no change"
    used = of.model.given("map_at")[0]
    np.testing.assert_array_equal(used.excess, made[-1][1])
    assert noisy.log_other - quiet.log_other == pytest.approx(-4.0 * math.log(2.0))


@pytest.mark.parametrize("strains", [1, 4])
def test_the_noise_of_a_mean_is_that_of_a_strain_over_their_number(strains: int) -> None:
    of, rng = localizer(), np.random.default_rng(0)
    for n in range(200):
        of.update(20_000_000 * n, np.array([n * STEP / strains]), 30.0 * rng.standard_normal(4))
    assert of.model.given("map_at")[0].excess.diagonal().mean() == pytest.approx(900.0 / strains, rel=0.4)


def test_a_gauge_that_stands_still_is_all_noise_and_its_phalanx_counts_by_the_others() -> None:
    of, rng = localizer(still=0.0), np.random.default_rng(0)
    for _ in range(6):
        strain = 0.1 * rng.standard_normal(4)
        strain[1] = 0.05
        move(of, strain=strain)
    assert len(of.model.record["with_noise"]) == 1, "it is still all noise"
    excess = of.model.given("map_at")[0].excess.diagonal()
    assert excess[1] >= 1e9
    assert excess[[0, 2, 3]].max() < 1.0
    assert of.model.given("on_map")[1].tolist() == [True, True]
    assert of.model.given("other")[3].tolist() == [True, True]


def test_an_absent_phalanx_does_not_count() -> None:
    of = localizer()
    move(of)
    of.update(10**9, np.array([0.02]), np.full(4, 0.1), np.array([False, True]))
    assert of.model.given("on_map")[1].tolist() == [False, True]
    assert of.model.given("other")[3].tolist() == [False, True]


def test_only_anchors_far_from_the_estimate_are_another_place() -> None:
    of = localizer()
    of.model.at_anchors = FAR
    move(of)
    near = np.abs(of._anchors.states[:, 0] - STATES[0, 0]) <= 0.01
    weights = of.explanations.anchor_weights
    assert near.any()
    assert not weights[near].any()
    assert weights[~near].min() > 0.0
