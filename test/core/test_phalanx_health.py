"""A phalanx that contradicts the belief is left out, reported, and taken back when it is well."""

from collections.abc import Callable

import numpy as np
import pytest

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import resource_path
from tactile_localizer.sim import simulate_scan

TEST = simulate_scan("bump", 41, "test", sweeps=3)


@pytest.fixture(scope="module")
def localizer() -> Localizer:
    scene = load_scene(resource_path("config/scenes/bump.yaml"))
    scan = simulate_scan("bump", seed=41).to_scan()
    return build_localizer(scan, scene, Configuration(), np.random.default_rng(0))


def on_feature(localizer: Localizer, hurt: Callable[[np.ndarray], np.ndarray]) -> list[Estimate]:
    """Estimates while the feature is felt, with the middle finger's voltages passed through ``hurt``."""
    estimates = []
    for number, part in enumerate(TEST.slices()):
        localizer.reset()
        for row in range(part.start, part.stop):
            strain = TEST.strain[row].copy()
            strain[8:] = hurt(strain[8:])
            estimate = localizer.update(int(TEST.stamp_ns[row]), TEST.odometry[row], strain)
            if TEST.contact[number] <= row <= TEST.feature_end[number]:
                estimates.append(estimate)
    return estimates


def test_well_phalanges_are_trusted(localizer: Localizer) -> None:
    trusted = np.array([estimate.trusted for estimate in on_feature(localizer, lambda strain: strain)])
    assert trusted.mean() > 0.95


@pytest.mark.parametrize(
    "hurt",
    [
        pytest.param(lambda strain: np.full(8, 0.123), id="constant"),
        pytest.param(lambda strain: strain[::-1], id="swapped"),
        pytest.param(lambda strain: 2.0 * strain, id="scaled"),
    ],
)
def test_a_lying_phalanx_is_left_out_and_the_other_is_not(
    localizer: Localizer, hurt: Callable[[np.ndarray], np.ndarray]
) -> None:
    trusted = np.array([estimate.trusted for estimate in on_feature(localizer, hurt)])
    assert trusted[:, 0].mean() > 0.95
    assert trusted[:, 1].mean() < 0.1


def test_a_phalanx_that_is_well_again_is_taken_back(localizer: Localizer) -> None:
    part = TEST.slices()[0]
    localizer.reset()
    seen = []
    for row in range(part.start, part.stop):
        strain = TEST.strain[row].copy()
        if row < part.start + (part.stop - part.start) // 4:
            strain[8:] = 0.123
        seen.append(localizer.update(int(TEST.stamp_ns[row]), TEST.odometry[row], strain).trusted[1])
    assert not all(seen)
    assert seen[-1]


def frozen(localizer: Localizer, *fingers: int) -> list[Estimate]:
    """Estimates before contact and the rest of a sweep, with fingers that say the same from 2 mm on."""
    part = TEST.slices()[0]
    localizer.reset()
    estimates = []
    for row in range(part.start, part.stop):
        strain = TEST.strain[row].copy()
        for finger in fingers:
            held = min(row, part.start + 30)
            strain[8 * finger : 8 * finger + 8] = TEST.strain[held, 8 * finger : 8 * finger + 8]
        estimates.append(localizer.update(int(TEST.stamp_ns[row]), TEST.odometry[row], strain))
    return estimates


def test_a_phalanx_that_says_the_same_while_the_other_changes_is_left_out_before_contact(
    localizer: Localizer,
) -> None:
    trusted = np.array([estimate.trusted for estimate in frozen(localizer, 1)])
    contact = TEST.contact[0] - TEST.slices()[0].start
    assert trusted[:30].all()
    assert trusted[:contact, 0].all()
    assert not trusted[contact:, 1].any()
    assert not trusted[100:contact, 1].any()


def test_where_all_say_the_same_none_is_left_out_for_it(localizer: Localizer) -> None:
    contact = TEST.contact[0] - TEST.slices()[0].start
    assert np.array([estimate.trusted for estimate in frozen(localizer, 0, 1)[:contact]]).all()
