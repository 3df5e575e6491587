"""A palm that is localized in x, y and yaw from sweeps at known angles."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_localizer.core.calibration.held_out import Calibration
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.likelihood.strain_map import VarianceModel
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import Axis, Phalanx, Scene
from tactile_localizer.sim import simulate_scan

BUMP = load_scene(resource_path("config/scenes/bump.yaml"))
SCENE = Scene(
    "turned bump",
    (*BUMP.axes, Axis("yaw", -0.2, 0.2, 0.05)),
    tuple(Phalanx(phalanx.name, (*phalanx.offset, 0.0)) for phalanx in BUMP.phalanges),
)
SCANNED = (-0.17, -0.085, 0.0, 0.085, 0.17)
CALIBRATION = Calibration(
    0.0017, np.array([0.0013, 0.0006, 0.046]), VarianceModel(0.241, 0.0175, 0.158, 0.0047)
)
"""As learned from held-out sweeps, which takes half a minute."""


@pytest.fixture(scope="module")
def localizer() -> Localizer:
    """On a bump that was scanned at five angles, one session after another, without a region."""
    sessions = [simulate_scan("bump", seed, yaw=yaw) for seed, yaw in enumerate(SCANNED, 1)]
    scan = Scan(
        np.concatenate(
            [np.insert(each.truth, 2, yaw, axis=1) for each, yaw in zip(sessions, SCANNED, strict=True)]
        ),
        np.concatenate([each.strain for each in sessions]),
        np.concatenate([each.sweep + 100 * number for number, each in enumerate(sessions)]),
        SCENE.axis_names,
        SCENE.phalanx_names,
    )
    return build_localizer(scan, SCENE, Configuration(), np.random.default_rng(0), calibration=CALIBRATION)


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
