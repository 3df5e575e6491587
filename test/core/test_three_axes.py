"""A palm that is localized in x, y and yaw from sweeps at known angles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.turned import SCENE, turned_scan

from tactile_localizer.core.calibration.held_out import Calibration
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.likelihood.strain_map import VarianceModel
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.sim import simulate_scan

SCANNED = (-0.17, -0.085, 0.0, 0.085, 0.17)
CALIBRATION = Calibration(
    0.0017, np.array([0.0013, 0.0006, 0.046]), VarianceModel(0.241, 0.0175, 0.158, 0.0047)
)
"""As learned from held-out sweeps, which takes half a minute."""


@pytest.fixture(scope="module")
def localizer() -> Localizer:
    """On a bump that was scanned at five angles, without a region."""
    scene = replace(SCENE, feature=None)
    rng = np.random.default_rng(0)
    scan = turned_scan(SCANNED, seeds=range(1, 6))
    return build_localizer(scan, scene, Configuration(), rng, calibration=CALIBRATION)


@pytest.mark.parametrize("yaw", [-0.12, 0.05])
def test_a_turned_hand_converges_on_the_feature_and_not_before(localizer: Localizer, yaw: float) -> None:
    test = simulate_scan("bump", 1, "test", yaw=yaw, sweeps=4)
    for rows, contact, end in zip(test.slices(), test.contact, test.feature_end, strict=True):
        localizer.reset()
        errors, turned = [], []
        for sample in range(rows.start, end):
            palm = np.array([*test.odometry[sample], yaw])
            estimate = localizer.update(test.stamp_ns[sample], palm, test.strain[sample])
            assert sample >= contact or not estimate.converged
            if estimate.converged:
                errors.append(np.linalg.norm(estimate.mean[:2] - test.truth[sample]))
                turned.append(abs(estimate.mean[2] - yaw))
        assert errors
        assert max(errors) < 0.01
        assert np.mean(errors) < 0.004
        assert np.mean(turned) < 0.035
