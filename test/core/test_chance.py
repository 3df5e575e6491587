"""On material where nothing is to be felt no position is believed, whatever the load cells do by themselves.

The hand here is not the simulated one: smooth fields over a plate, mixed into the gauges at random, with slow
and fast noise, an offset and a gain of each sweep.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Axis, Phalanx, Region, Scene

SIDE, SPACING, STEP = 0.06, 0.005, 0.0004
MIDDLE = np.array([0.03, 0.03])
OFFSETS = np.array([[0.0, -0.011], [0.0, 0.011]])
NOISE, LENGTH = 0.01, 0.02
"""V, of the fast noise and of the slow one, and m over which the slow one changes."""
SCENE = Scene(
    "plate",
    (Axis("x", 0.0, SIDE), Axis("y", 0.0, SIDE)),
    tuple(Phalanx(name, tuple(offset)) for name, offset in zip(("index", "middle"), OFFSETS, strict=True)),
    Region((0.015, 0.015), (0.045, 0.045)),
    {
        "position_std": 0.0028,
        "strain_std": 0.018,
        "correlation_length": 0.003,
        "interpolate": True,
        "sweep_offset": True,
    },
)


class Plate:
    """Bumps under two phalanges; ``glitches`` is the share of strains that are nonsense."""

    def __init__(self, seed: int, glitches: float = 0.0) -> None:
        self._rng = np.random.default_rng(seed)
        self._mixing = self._rng.standard_normal((2, 8, 3))
        self._bumps = [
            (MIDDLE + 0.006 * self._rng.standard_normal(2), self._rng.uniform(0.003, 0.006)) for _ in range(3)
        ]
        self._glitches = glitches

    def sweep(self, y: float, blank: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """States (N, 2) along a line and the strains (N, 16) on it."""
        rng = self._rng
        x = np.arange(0.0, SIDE, STEP)
        states = np.stack([x, np.full_like(x, y)], axis=1)
        gains = 1.0 + 0.05 * rng.standard_normal(2)
        felt = [
            gain * self._field(states + offset) @ mixing.T
            for gain, offset, mixing in zip(gains, OFFSETS, self._mixing, strict=True)
        ]
        strain = np.zeros((len(x), 16)) if blank else np.hstack(felt)
        keep = np.exp(-STEP / LENGTH)
        slow = NOISE * rng.standard_normal((len(x), 16))
        for t in range(1, len(x)):
            slow[t] = keep * slow[t - 1] + np.sqrt(1.0 - keep**2) * slow[t]
        strain += slow + NOISE * rng.standard_normal(strain.shape) + 0.03 * rng.standard_normal(16)
        glitch = rng.random(len(x)) < self._glitches
        strain[glitch] += 3.0 * rng.standard_normal((glitch.sum(), 16))
        return states, strain

    def scan(self) -> Scan:
        """Parallel lines over all of the plate."""
        sweeps = [self.sweep(y) for y in np.arange(SPACING / 2, SIDE, SPACING)]
        states, strain = (np.concatenate(parts) for parts in zip(*sweeps, strict=True))
        number = np.repeat(np.arange(len(sweeps)), len(sweeps[0][0]))
        return Scan(states, strain, number, ("x", "y"), ("index", "middle"))

    def _field(self, positions: np.ndarray) -> np.ndarray:
        """Height and slopes, in widths, at positions (N, 2): (N, 3)."""
        field = np.zeros((len(positions), 3))
        for centre, width in self._bumps:
            away = (positions - centre) / width
            height = np.exp(-0.5 * np.sum(away**2, axis=1))
            field += np.column_stack([height, -away * height[:, None]])
        return field


def believed(localizer: Localizer, states: np.ndarray, strain: np.ndarray) -> np.ndarray:
    """Errors, m, of the positions that are believed along a sweep."""
    localizer.reset()
    errors = []
    for t, (state, felt) in enumerate(zip(states, strain, strict=True)):
        estimate = localizer.update(t * 10_000_000, state - states[0], felt)
        if estimate.converged:
            errors.append(np.linalg.norm(estimate.mean - state))
    return np.array(errors)


@pytest.mark.parametrize("glitches", [0.0, 0.01])
@pytest.mark.parametrize("region", [SCENE.feature, None], ids=["region given", "region found"])
def test_featureless_material_is_not_taken_for_a_place(glitches, region) -> None:
    plate = Plate(1, glitches)
    scene = dataclasses.replace(SCENE, feature=region)
    localizer = build_localizer(plate.scan(), scene, Configuration(), np.random.default_rng(0))
    lines = np.linspace(0.3, 0.7, 6) * SIDE
    blank = [believed(localizer, *plate.sweep(y, blank=True)) for y in lines]
    assert sum(len(errors) > 0 for errors in blank) == 0
    felt = [believed(localizer, *plate.sweep(y)) for y in lines]
    assert all(len(errors) > 0 for errors in felt), "the feature itself is believed"
    assert np.median(np.concatenate(felt)) < 0.002
