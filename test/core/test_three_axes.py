"""A palm that is localized in x, y and yaw from sweeps at known angles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.calibration.examination import Examination
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.io.recording import join, scan_of
from tactile_localizer.scene import Axis, Phalanx, Scene
from tactile_localizer.sim import shipped_scene, simulate_recording

BUMP = shipped_scene("bump")
SCENE = Scene(
    "turned bump",
    (*BUMP.axes, Axis("yaw", -0.2, 0.2, 0.05)),
    tuple(Phalanx(phalanx.name, (*phalanx.offset, 0.0)) for phalanx in BUMP.phalanges),
)
SCANNED = (-0.17, -0.085, 0.0, 0.085, 0.17)


@pytest.fixture(scope="module")
def localizer() -> Localizer:
    """On a bump that was scanned at five angles, one session after another, without a region."""
    sessions = []
    for seed, yaw in enumerate(SCANNED, 1):
        session = simulate_recording("bump", seed, yaw=yaw)
        turned = [replace(each, position=np.insert(each.truth, 2, yaw, axis=1)) for each in session.sweeps]
        sessions.append(replace(session, sweeps=turned))
    scan = scan_of(join(sessions), SCENE)
    rng, std = np.random.default_rng(0), np.array([1e-3, 1e-3, 0.01])
    known = Calibration(std, Material.SHEET, examination=Examination(0.003, 0.003))
    return build_localizer(scan, SCENE, Configuration(), rng, calibration=known)


@pytest.mark.parametrize("yaw", [-0.12, 0.05])
def test_a_turned_hand_converges_on_the_feature_and_not_before(localizer: Localizer, yaw: float) -> None:
    for sweep in simulate_recording("bump", 1, "test", yaw=yaw, sweeps=4).sweeps:
        localizer.reset()
        errors, turned = [], []
        contact, end = sweep.contact
        for sample in range(end):
            palm = np.array([*sweep.position[sample], yaw])
            estimate = localizer.update(sweep.stamp_ns[sample], palm, sweep.strain[sample])
            assert sample >= contact or not estimate.converged
            if estimate.converged:
                errors.append(np.linalg.norm(estimate.mean[:2] - sweep.truth[sample]))
                turned.append(abs(estimate.mean[2] - yaw))
        assert errors
        assert max(errors) < 0.01
        assert np.mean(errors) < 0.004
        assert np.mean(turned) < 0.035
