"""Several scans as one localizer: the estimate of the most probable candidate, and none on none of them."""

import numpy as np
import pytest
from support.sweeps import CALIBRATION

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_identifier
from tactile_localizer.core.hypotheses.convergence import ConvergenceCriteria
from tactile_localizer.core.identification import FeatureLocalizer
from tactile_localizer.core.localizer import Estimate
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import resource_path
from tactile_localizer.sim import simulate_scan

pytestmark = pytest.mark.slow

SEED = 31
CONFIGURATION = Configuration()
RADIUS = np.array([CONFIGURATION.convergence_radius] * 2)


@pytest.fixture(scope="module")
def candidates() -> FeatureLocalizer:
    scans = {
        feature: (
            simulate_scan(feature, seed=SEED).to_scan(),
            load_scene(resource_path(f"config/scenes/{feature}.yaml")),
        )
        for feature in ("grommet", "bump")
    }
    calibrations = dict.fromkeys(scans, CALIBRATION)  # given, so that no test waits for it
    rng = np.random.default_rng(0)
    return FeatureLocalizer(build_identifier(scans, CONFIGURATION, rng, None, calibrations))


@pytest.fixture
def localizer(candidates: FeatureLocalizer) -> FeatureLocalizer:
    candidates.adjust(ConvergenceCriteria(RADIUS), CONFIGURATION.update_distance)
    candidates.reset()
    return candidates


def slide(localizer: FeatureLocalizer, material: str) -> list[Estimate]:
    """Estimates along a sweep."""
    test = simulate_scan(material, SEED, "test", sweeps=1)
    return [
        localizer.update(int(test.stamp_ns[row]), test.odometry[row], test.strain[row])
        for row in range(len(test.strain))
    ]


def test_the_estimate_is_that_of_the_most_probable_candidate(localizer: FeatureLocalizer) -> None:
    last = slide(localizer, "bump")[-1]
    assert localizer.identification is not None
    assert localizer.identification.most_probable == localizer.scene.name == "bump"
    assert last is localizer.identification.estimates["bump"]
    assert last.converged
    states, weights = localizer.hypotheses()
    np.testing.assert_allclose(weights @ states, last.mean, atol=1e-3)


def test_on_none_of_the_features_no_position_converges(localizer: FeatureLocalizer) -> None:
    assert not any(estimate.converged for estimate in slide(localizer, "none"))


def test_a_seed_holds_for_every_candidate(
    localizer: FeatureLocalizer,
) -> None:
    slide(localizer, "none")
    place = np.array([0.02, 0.03])
    localizer.seed(place, np.array([0.002, 0.002]))
    assert localizer.identification is None
    states, weights = localizer.hypotheses()
    np.testing.assert_allclose(weights @ states, place, atol=1e-3)


def test_what_converged_means_can_be_adjusted_for_all(localizer: FeatureLocalizer) -> None:
    localizer.adjust(ConvergenceCriteria(RADIUS, sustain=1.0), CONFIGURATION.update_distance)
    assert not any(estimate.converged for estimate in slide(localizer, "bump"))
