"""Which of several features is felt, and whether it is one of them at all."""

from collections.abc import Iterator

import numpy as np
import pytest
from support.sweeps import CALIBRATION

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_identifier
from tactile_localizer.core.identification import NONE, FeatureIdentifier, Mixture
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import resource_path
from tactile_localizer.sim import simulate_scan

pytestmark = pytest.mark.slow

SEED = 31


@pytest.fixture(scope="module")
def identifier() -> FeatureIdentifier:
    candidates = {}
    for feature in ("bump", "grommet"):
        scene = load_scene(resource_path(f"config/scenes/{feature}.yaml"))
        candidates[feature] = (simulate_scan(feature, seed=SEED).to_scan(), scene)
    calibrations = dict.fromkeys(candidates, CALIBRATION)  # given, so that no test waits for it
    return build_identifier(candidates, Configuration(), np.random.default_rng(0), None, calibrations)


def verdicts(
    identifier: FeatureIdentifier, material: str, sweeps: int = 4, present: np.ndarray | None = None
) -> Iterator[str]:
    """The most probable candidate at the end of the feature, or of the sweep where there is none."""
    test = simulate_scan(material, SEED, "test", sweeps=sweeps)
    for number, part in enumerate(test.slices()):
        identifier.reset()
        last = test.feature_end[number] if test.feature_end[number] >= 0 else part.stop - 1
        for row in range(part.start, last + 1):
            result = identifier.update(int(test.stamp_ns[row]), test.odometry[row], test.strain[row], present)
            assert sum(result.probabilities.values()) == pytest.approx(1.0)
        yield result.most_probable


def test_a_scanned_feature_is_recognised_in_most_sweeps(identifier: FeatureIdentifier) -> None:
    assert list(verdicts(identifier, "bump")).count("bump") >= 3
    assert list(verdicts(identifier, "grommet")).count("grommet") >= 3


def test_one_phalanx_alone_recognises_the_feature_that_it_touches(identifier: FeatureIdentifier) -> None:
    heard = list(verdicts(identifier, "grommet", present=np.array([False, True])))
    assert heard.count("grommet") >= 3


def test_a_feature_that_no_scan_has_shown_is_none_of_them(identifier: FeatureIdentifier) -> None:
    assert list(verdicts(identifier, "seam")).count(NONE) >= 3


def test_featureless_material_all_the_way_is_none_of_them(identifier: FeatureIdentifier) -> None:
    assert list(verdicts(identifier, "none")) == [NONE] * 4


def test_a_hand_that_rides_off_the_map_of_a_recognised_feature_is_still_on_it(
    identifier: FeatureIdentifier,
) -> None:
    test = simulate_scan("bump", SEED, "test", sweeps=1)
    identifier.reset()
    for row in range(test.feature_end[0] + 1):
        found = identifier.update(int(test.stamp_ns[row]), test.odometry[row], test.strain[row])
    assert found.estimates["bump"].converged
    before = found.probabilities["bump"]
    ahead = test.odometry[row] + [0.05, 0.0]
    after = identifier.update(int(test.stamp_ns[row]) + 10**9, ahead, test.strain[test.slices()[0].start])
    assert after.probabilities["bump"] > 0.9 * before


def test_candidates_have_one_noise(identifier: FeatureIdentifier) -> None:
    one, other = (localizer.model for localizer in identifier.localizers.values())
    strain = np.linspace(-0.1, 0.1, 16)
    np.testing.assert_allclose(one.whitened(strain), other.whitened(strain))
    np.testing.assert_allclose(one.offset_variance, other.offset_variance)


def test_what_one_explanation_predicts_all_along_is_not_diluted_by_the_others() -> None:
    mixture = Mixture(3)
    total = sum(mixture.update(np.array([-1.0, -5.0, -5.0])) for _ in range(100))
    assert total == pytest.approx(-100.0 - np.log(3.0), abs=1e-3)
    assert mixture.update(np.full(3, -np.inf)) == -np.inf
    assert mixture.update(np.array([-5.0, -30.0, -30.0])) == pytest.approx(-5.0, abs=1e-3)


def test_before_anything_is_felt_no_candidate_is_ahead(identifier: FeatureIdentifier) -> None:
    identifier.reset()
    test = simulate_scan("none", SEED, "test", sweeps=1)
    result = identifier.update(int(test.stamp_ns[0]), test.odometry[0], test.strain[0])
    assert set(result.probabilities) == {"bump", "grommet", NONE}
    assert max(result.probabilities.values()) < 0.6
