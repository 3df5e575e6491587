"""Small exact tests of what the decision is made of: each has an answer in closed form.

Together with the figures of `test/regression` they fail when a mechanism of the decision is lost.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.models import noise_model

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.hypotheses.explanations import RELOCATION_RATE, Explanations
from tactile_localizer.core.likelihood.drift import Drift, Innovation, Trend, innovations
from tactile_localizer.core.likelihood.gain import LEAST_VARIANCE, Gain
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.on_map import Places
from tactile_localizer.core.likelihood.other_material import PATCH_LENGTH, OtherMaterial
from tactile_localizer.core.likelihood.strain_map import StrainMap, VarianceModel
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.core.scan.interpolation import Expectation

# Explanations: tracked, relocated, and material off the map.

EVEN, STAYING = np.full(4, 0.25), np.zeros(4, dtype=bool)


def test_a_hand_leaves_the_map_returns_to_it_and_is_placed_elsewhere_by_their_rates() -> None:
    stays = math.exp(-0.1 / PATCH_LENGTH)
    unmoved = math.exp(-RELOCATION_RATE * 0.1)
    moved = Explanations(0.5, 0.2, 0.3, EVEN).predict(0.1, 0.2, STAYING)
    assert moved.tracked == pytest.approx((0.8 * stays * 0.5 + (1.0 - stays) * 0.3) * unmoved)
    left = (1.0 - 0.8 * stays) * 0.5 + (1.0 - stays) * 0.2
    assert moved.other == pytest.approx((stays * 0.3 + left) * unmoved)


@pytest.mark.parametrize("travel", [0.0002, 0.0005, 0.002])
def test_the_probabilities_do_not_depend_on_how_often_there_is_an_update(travel: float) -> None:
    """Rates and evidence are per metre: after 20 mm of the same evidence the map is as sure."""
    explanations, nowhere = Explanations.start(4), np.full(4, -np.inf)
    for _ in range(round(0.02 / travel)):
        explanations = explanations.predict(travel, 0.0, STAYING).update(travel, nowhere, -400.0 * travel)
    assert explanations.other == pytest.approx(0.0073, rel=0.3)
    assert explanations.tracked > 0.97


def test_parts_of_a_measurement_add_up_to_the_whole() -> None:
    before = Explanations(0.4, 0.2, 0.4, EVEN)
    elsewhere = np.array([1.0, -2.0, 0.5, -1.0])
    whole, parts = before.update(0.2, elsewhere, 0.7), before
    for _ in range(4):
        parts = parts.update(0.05, 0.25 * elsewhere, 0.25 * 0.7)
    assert parts[:3] == pytest.approx(whole[:3])
    np.testing.assert_allclose(parts.anchor_weights, whole.anchor_weights)


# The level and rate by which a sweep differs from the scan.

NOWHERE = np.zeros((0, 1), dtype=np.float32)


def test_after_an_outlier_the_level_is_known_half_as_well() -> None:
    drift, n = Drift(np.inf, 1.0, np.array([np.inf]), largest_energy=1.0), 10
    trend = drift.start(0)
    for _ in range(n):
        _, trend = drift.update(trend, np.zeros(1), NOWHERE, 0.0005, 1.0)
    _, after = drift.update(trend, np.full(1, 1e9), NOWHERE, 0.0005, 1.0)
    for before, variance in ((trend, 1.0 / n), (after, 2.0 / n)):
        following, _ = drift.update(before, np.zeros(1), NOWHERE, 0.0005, 1.0)
        assert following.level_variance == pytest.approx(variance, rel=1e-6)


def test_a_step_fades_as_in_a_critically_damped_system() -> None:
    """The level forgets over a memory m, the rate is learned over 4 m: (1 - t / 2m) exp(-t / 2m)."""
    memory, pitch = 0.01, 0.00005
    steps = np.repeat([0.0, 1.0], [8000, 1600])[:, None]
    found = innovations(steps, memory, pitch)[8000:, 0]
    half_turns = np.arange(len(found)) * pitch / (2.0 * memory)
    np.testing.assert_allclose(found, (1.0 - half_turns) * np.exp(-half_turns), atol=0.01)


# A turned hand on featureless material, which feels the same in proportion to its yaw.

YAWS = np.linspace(-0.2, 0.2, 41)
TURNING = np.array([30.0, -10.0])


def turned_material(level_variance: float = 0.0) -> SweepMixture:
    """Featureless material under one phalanx of two channels, at yaws 0.01 rad apart; variances are one."""
    layout = ChannelLayout((2,))
    noise = noise_model(layout, level_variance=level_variance, turning=TURNING)
    lattice, same = (YAWS[:1], np.full(1, 0.01), (41,)), np.zeros((41, 1, 2), np.float32)
    tables = same, np.ones((41, 1, 1), np.float32), same[..., 0]
    strain_map = StrainMap(*lattice, *tables, 0.0, TURNING[None])
    drift = Drift(np.inf, 1.0, np.full(2, level_variance))
    return SweepMixture(
        noise, strain_map, drift, OtherMaterial(layout, np.eye(2), np.ones(layout.phalanges)), Material.SHEET
    )


def felt_at_yaw(yaw: float, weights: np.ndarray, model: SweepMixture) -> tuple[np.ndarray, Innovation, Trend]:
    """Likelihoods and innovation of what featureless material feels like at a yaw, and the trend after it."""
    places = np.tile(YAWS, 2)[:, None]
    nodes, expected = model.map_at(places)
    start, felt = model.drift.start(len(places)), yaw * TURNING
    innovation, trend = model.innovation(start, felt, places, expected, weights, 0.0005, 1.0)
    gain, every = Gain.start(1, len(places), model.gain_variance), np.ones(1, dtype=bool)
    there = Places(nodes, len(YAWS), innovation.of_map, gain)
    found = model.on_map(model.felt(innovation, every), there, 1.0)
    return np.concatenate([found.states, found.anchors]), innovation, trend


def test_a_turned_hand_feels_what_featureless_material_feels_like_at_its_yaw() -> None:
    weights = np.exp(-0.5 * ((YAWS - 0.05) / 0.04) ** 2)
    found, innovation, _ = felt_at_yaw(YAWS[5], weights / weights.sum(), turned_material())
    assert found[: len(YAWS)].argmax() == found[len(YAWS) :].argmax() == 5
    # Without a residual the volume is left, in which the gain of what turned is open.
    turned = YAWS[5] * TURNING - innovation.turned
    assert found[5] == pytest.approx(-0.5 * np.log1p(LEAST_VARIANCE * turned @ turned), abs=1e-4)
    np.testing.assert_allclose(innovation.of_strain + innovation.turned, YAWS[5] * TURNING, rtol=1e-6)


def test_the_variance_of_the_yaw_counts_as_noise() -> None:
    """The level is that of a Kalman filter with the variance of the strain about the mean yaw as noise."""
    weights, level_variance = np.full(41, 1.0 / 41.0), 5.0
    _, _, trend = felt_at_yaw(0.1, weights, turned_material(level_variance))
    noise = 1.0 + np.var(YAWS) * TURNING**2
    np.testing.assert_allclose(trend.level, 0.1 * TURNING * level_variance / (level_variance + noise))


# What is learned from a scan.


def test_variance_is_of_the_visit_the_signal_and_the_interpolation() -> None:
    expected = Expectation(
        mean=np.array([[[1.0, 3.0, 2.0]]]),
        interpolation_error=np.array([[[4.0, 8.0, 1.0]]]),
        noise=np.array([[0.5]]),
        log_prior=np.zeros((1, 1)),
        distance=np.zeros(1),
    )
    found = VarianceModel(visit=2.0, signal=0.1, interpolation=0.5).variance(expected, ChannelLayout((2, 1)))
    np.testing.assert_allclose(
        found, [[[2.0 * 1.5 + 0.1 * 5.0 + 0.5 * 6.0, 2.0 * 1.5 + 0.1 * 4.0 + 0.5 * 1.0]]]
    )
