"""Deformation of the material during one sweep: its mode, and the stretch around the feature.

The mode is drawn when the fingers close, correlated with that of the previous sweep. It may change at a
deformation event, and is mostly flattened as the pad passes the middle of the feature (paper, Sec. III-C:
several trajectories on the first part of the feature, fewer on the second).
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from tactile_localizer.sim.material import MODES
from tactile_localizer.sim.noise import smooth

_SAME_MODE_PROBABILITY = 0.45
"""Probability that a sweep starts in the mode of the sweep before without a new draw."""

_EVENT_PROBABILITY = 0.3
"""Probability of a change of mode within a sweep."""

_EVENT_WIDTH_M = 0.25e-3
"""Travel over which the mode changes, m."""

_FLATTENED_FRACTION = 0.8
"""Fraction of a mode's deformation that is gone behind the middle of the feature."""

_STRETCH_STD_M = 0.3e-3
"""Standard deviation of the stretch, between sweeps and within one, m."""

_STRETCH_LENGTH_M = 12e-3
"""Correlation length of the stretch within a sweep, m."""


@dataclass(frozen=True)
class Deformation:
    """Deformation along a sweep of n samples.

    Parameters
    ----------
    weights : (n, modes) weight of each of :data:`MODES`; they sum to one
    stretch : (n, 2) displacement of the material under the fingers from its undeformed position, m
    """

    weights: np.ndarray
    stretch: np.ndarray


def mode_of_sweep(rng: np.random.Generator, number: int) -> int:
    """Index of the mode at the start of sweep ``number``: state of a Markov chain after so many steps."""
    mode = int(rng.integers(len(MODES)))
    for _ in range(number):
        if rng.random() > _SAME_MODE_PROBABILITY:
            mode = int(rng.integers(len(MODES)))
    return mode


def deformation(rng: np.random.Generator, mode: int, x: np.ndarray, spacing: float) -> Deformation:
    """Draw the deformation along one sweep.

    Parameters
    ----------
    rng : random generator
    mode : index of the mode at the start
    x : (n,) palm position along the sweep relative to the feature's centre, m
    spacing : approximate distance between samples, m
    """
    other = (mode + int(rng.integers(1, len(MODES)))) % len(MODES)
    event = rng.uniform(-12e-3, 0.0) if rng.random() < _EVENT_PROBABILITY else np.inf
    flattened = _FLATTENED_FRACTION * expit((x - rng.normal(3e-3, 1.5e-3)) / 0.9e-3)
    after = expit((x - event) / _EVENT_WIDTH_M) * (1 - flattened)
    before = 1 - flattened - after
    size = rng.normal(1.0, 0.12, 2)

    weights = np.zeros((len(x), len(MODES)))
    weights[:, mode] += size[0] * before
    weights[:, other] += size[1] * after
    weights[:, 0] += 1 - np.sum(weights, axis=1)
    between = rng.normal(0, _STRETCH_STD_M, 2)
    within = _STRETCH_STD_M * smooth(rng, len(x), 2, _STRETCH_LENGTH_M / spacing)
    return Deformation(weights, between + within)
