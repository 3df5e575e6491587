"""How the sheet lies during one sweep: its deformation mode and the stretch around the feature.

The mode is chosen when the fingers close, with some memory of the sweep before, may jump to another
at a deformation event, and is mostly pressed out as the pad passes the feature's middle (paper,
Sec. III-C: several trajectories on the first part of the feature, fewer after).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from tactile_localizer.sim.material import MODES
from tactile_localizer.sim.noise import smooth

_STAYS = 0.45
_EVENT_PROBABILITY = 0.3
_EVENT_WIDTH_M = 0.25e-3
_PRESSED_OUT = 0.8
_STRETCH_M = 0.3e-3
_STRETCH_LENGTH_M = 12e-3


@dataclass(frozen=True)
class Deformation:
    """The sheet's lie along a sweep of n samples.

    Parameters
    ----------
    weights : (n, modes) share of each of :data:`MODES`; the rest shape takes what the others leave
    stretch : (n, 2) m, how far the material under the fingers is from where it would lie undeformed
    """

    weights: np.ndarray
    stretch: np.ndarray


def mode_of_sweep(rng: np.random.Generator, number: int) -> int:
    """Index of the mode that sweep ``number`` starts in: the ``number``-th link of a Markov chain."""
    mode = int(rng.integers(len(MODES)))
    for _ in range(number):
        if rng.random() > _STAYS:
            mode = int(rng.integers(len(MODES)))
    return mode


def deformation(rng: np.random.Generator, mode: int, x: np.ndarray, spacing: float) -> Deformation:
    """Draw the lie of the sheet for one sweep.

    Parameters
    ----------
    mode : index of the mode at the start
    x : (n,) m, palm from the feature's centre along the sweep
    spacing : m between samples, roughly
    """
    other = (mode + int(rng.integers(1, len(MODES)))) % len(MODES)
    event = rng.uniform(-12e-3, 0.0) if rng.random() < _EVENT_PROBABILITY else np.inf
    pressed_out = _PRESSED_OUT * expit((x - rng.normal(3e-3, 1.5e-3)) / 0.9e-3)
    after = expit((x - event) / _EVENT_WIDTH_M) * (1 - pressed_out)
    before = 1 - pressed_out - after
    size = rng.normal(1.0, 0.12, 2)

    weights = np.zeros((len(x), len(MODES)))
    weights[:, mode] += size[0] * before
    weights[:, other] += size[1] * after
    weights[:, 0] += 1 - np.sum(weights, axis=1)
    stretch = rng.normal(0, _STRETCH_M, 2) + _STRETCH_M * smooth(rng, len(x), 2, _STRETCH_LENGTH_M / spacing)
    return Deformation(weights, stretch)
