"""Registration error: how far the positions of one sweep are from those of another.

Fingers flex, material stretches and recordings start late, which shifts sweeps against each other. All
strains of a sweep share that shift, so the covariance of a filter does not include it. Its variance is what
that covariance does not explain of the errors of held-out sweeps, and is added to it.
"""

from collections.abc import Sequence

import numpy as np

from tactile_localizer.core.calibration.trials import Outcome
from tactile_localizer.core.geometry.motion import levers
from tactile_localizer.scene import Scene

_PRIOR_STD, _PRIOR_ERRORS = 0.0015, 5.0
"""Prior of the registration error, m, and the number of independent errors it counts as: later sweeps move
more than those of a scan. By judgement."""
_ITERATIONS = 50


def registration_std(scene: Scene, outcomes: Sequence[Outcome] = ()) -> np.ndarray:
    """Standard deviation (d,) of the registration error, m (yaw: rad), from sweeps that are right at the end.

    EM over the registration errors (Laird and Ware, 1982).
    """
    scale = levers(scene)
    shape = (len(outcomes), scene.dimension)
    squared, variance = (
        np.square(np.reshape([getattr(each, name) for each in outcomes], shape) * scale)
        for name in ("error", "spread")
    )
    count, found = _PRIOR_ERRORS + len(outcomes), np.full(scene.dimension, _PRIOR_STD**2)
    for _ in range(_ITERATIONS):
        total = found + variance
        squares = squared * (found / total) ** 2 + found * variance / total
        found = (_PRIOR_ERRORS * _PRIOR_STD**2 + squares.sum(axis=0)) / count
    return np.asarray(np.sqrt(found) / scale)
