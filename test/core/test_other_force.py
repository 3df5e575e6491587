"""Smooth material that is felt everywhere, used with a force that varies where the scan's was constant."""

from collections.abc import Callable

import numpy as np
import pytest
from support.scans import raster

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.calibration.examination import Examination
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.hypotheses.convergence import State
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.scene import Axis, Phalanx, Scene

SCENE = Scene("field", (Axis("x", 0.0, 0.05), Axis("y", 0.0, 0.021)), (Phalanx("finger", (0.0, 0.0), 6),))
LENGTH, NOISE, SWEEPS = 0.018, 0.06, 10
X = np.arange(0.0, 0.05, 0.0005)
Force = Callable[[np.random.Generator], np.ndarray]


def wandering(rng: np.random.Generator) -> np.ndarray:
    """By a fifth, within 12 mm."""
    found, kept = [rng.standard_normal()], np.exp(-0.0005 / 0.012)
    while len(found) < len(X):
        found.append(kept * found[-1] + np.sqrt(1.0 - kept**2) * rng.standard_normal())
    return 1.0 + 0.2 * np.array(found)


def trembling(rng: np.random.Generator) -> np.ndarray:
    """By up to six tenths, from strain to strain."""
    return rng.uniform(0.4, 1.6, len(X))


class Field:
    """Six sums of waves in random directions, over a strain that a force has everywhere.

    ``offset`` is the standard deviation of what the channels show without a force.
    """

    def __init__(self, seed: int, offset: float) -> None:
        rng = np.random.default_rng(seed)
        self._waves, self._phase = rng.standard_normal((200, 2)) / LENGTH, rng.uniform(0.0, 6.28, 200)
        self._amplitudes = rng.standard_normal((200, 6)) / 10.0
        self._even, self._offset = 1.2 * rng.standard_normal(6), offset * rng.standard_normal(6)

    def strain(self, states: np.ndarray, force: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """What is felt at states (n, 2) with forces (n,), in those of the scan, with noise, (n, 6) V."""
        felt = self._even + np.cos(states @ self._waves.T + self._phase) @ self._amplitudes
        return self._offset + force[:, None] * felt + NOISE * rng.standard_normal(felt.shape)

    def localizer(self) -> Localizer:
        """On a scan at a constant force."""
        rng = np.random.default_rng(0)
        made = raster(SCENE, lambda states, _: self.strain(states, np.ones(len(states)), rng), 0.0014)
        known = Calibration(np.full(2, 6e-4), Material.CLOTH, examination=Examination(0.0017))
        return build_localizer(made, SCENE, Configuration(), rng, calibration=known)


def used(seed: int, offset: float, force: Force) -> tuple[np.ndarray, np.ndarray, list[State]]:
    """Errors (n,), m, of all strains, which of them are converged, and the state at the end of each sweep."""
    material, rng = Field(seed, offset), np.random.default_rng(seed)
    localizer = material.localizer()
    errors, converged, ends = [], [], []
    for _ in range(SWEEPS):
        localizer.reset()
        states = np.column_stack([X, np.full(len(X), rng.uniform(0.003, 0.018))])
        for number, (place, felt) in enumerate(
            zip(states, material.strain(states, force(rng), rng), strict=True)
        ):
            estimate = localizer.update(20_000_000 * number, place + 0.3, felt)
            errors.append(np.linalg.norm(estimate.mean - place))
            converged.append(estimate.converged)
        ends.append(estimate.state)
    return np.array(errors), np.array(converged), ends


@pytest.mark.parametrize("force", [wandering, trembling])
@pytest.mark.parametrize("offset", [0.0, 3.0])
@pytest.mark.parametrize("seed", [3, 4, 5])
def test_under_a_force_that_varies_no_position_is_certain_and_wrong(
    seed: int, offset: float, force: Force
) -> None:
    """Of one variance for all directions, two materials of these six had some under a force that wanders."""
    errors, converged, _ = used(seed, offset, force)
    assert np.mean(errors[converged] > 0.0075) < 0.01
    assert np.median(errors[converged]) < 0.002


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_a_force_that_scales_what_is_felt_above_zero_does_not_make_it_other_material(seed: int) -> None:
    _, _, ends = used(seed, 0.0, wandering)
    assert ends.count(State.CONVERGED) >= SWEEPS - 1
