"""Smooth material that is felt everywhere, used with a force that varies where the scan's was constant."""

import numpy as np
import pytest
from forces import FORCES, SCENE, Field

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.calibration.examination import Examination
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.hypotheses.convergence import State
from tactile_localizer.core.likelihood.material import Material

SWEEPS = 10


def used(seed: int, offset: float, force: str) -> tuple[np.ndarray, np.ndarray, list[State]]:
    """Errors (n,), m, of all strains, which of them are converged, and the state at the end of each sweep."""
    rng, field = np.random.default_rng(seed), Field(seed, 0.018, offset)
    known = Calibration(np.full(2, 6e-4), Material.CLOTH, examination=Examination(0.0017, 0.0017))
    localizer = build_localizer(field.scan(rng), SCENE, Configuration(), rng, calibration=known)
    errors, converged, ends = [], [], []
    for sweep in field.sweeps(FORCES[force], SWEEPS, rng).sweeps:
        localizer.reset()
        for stamp, place, strain, present in sweep.samples():
            estimate = localizer.update(stamp, place + 0.3, strain, present)
            errors.append(np.linalg.norm(estimate.mean - place))
            converged.append(estimate.converged)
        ends.append(estimate.state)
    return np.array(errors), np.array(converged), ends


@pytest.mark.parametrize("force", ["wanders", "trembles"])
@pytest.mark.parametrize("offset", [0.0, 3.0])
@pytest.mark.parametrize("seed", [3, 4, 5])
def test_under_a_force_that_varies_no_position_is_certain_and_wrong(
    seed: int, offset: float, force: str
) -> None:
    errors, converged, _ = used(seed, offset, force)
    assert np.mean(errors[converged] > 0.0075) < 0.01
    assert np.median(errors[converged]) < 0.002


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_a_force_that_scales_what_is_felt_above_zero_does_not_make_it_other_material(seed: int) -> None:
    _, _, ends = used(seed, 0.0, "wanders")
    assert ends.count(State.CONVERGED) >= SWEEPS - 1
