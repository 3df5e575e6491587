"""From a scan and a scene to a localizer of the sweep mixture."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tactile_localizer.core.calibration.registration import registration_std
from tactile_localizer.core.calibration.sweep_model import SweepModel, learn_sweep_model
from tactile_localizer.core.decision.convergence import Convergence, ConvergenceCriteria
from tactile_localizer.core.filters.grid import GridFilter
from tactile_localizer.core.likelihood.slow_residual import SlowResidual
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.sweep_localizer import SweepLocalizer
from tactile_localizer.scene import Scene

_RADIUS = 0.0075
_YAW_RADIUS = 0.15
"""m and rad about the estimate within which the hand has to be: the error up to which a position is right
(5 mm), with half as much again for what is not known of it."""


def build_sweep_localizer(
    scan: Scan,
    scene: Scene,
    update_distance: float,
    cell: float,
    progress: Callable[[str, float], None] | None = None,
) -> SweepLocalizer:
    """A localizer that learned its noise from ``scan``.

    Parameters
    ----------
    update_distance : m of travel between two measurement updates
    cell : size of the grid's cells in spacings of the scan's lines; on one axis they are 0.5 mm
    progress : called with what is being done and the fraction of it that is done

    Raises
    ------
    SceneError
        The scene and the scan do not fit together.
    """
    say = progress or (lambda _doing, _done: None)
    say("learning the noise", 0.0)
    learned = learn_sweep_model(scan, scene)
    say("learning the registration", 0.3)

    def made(mixture: SweepMixture, registration: np.ndarray) -> SweepLocalizer:
        return _assembled(scene, learned, mixture, registration, update_distance)

    plain = np.zeros(scene.dimension)
    registration = registration_std(scan, scene, learned, lambda mixture: made(mixture, plain))
    say("learning the registration", 1.0)
    return made(learned.mixture(scene, cell), registration)


def _assembled(
    scene: Scene, learned: SweepModel, mixture: SweepMixture, registration: np.ndarray, update_distance: float
) -> SweepLocalizer:
    radius = [_YAW_RADIUS if axis.name == "yaw" else _RADIUS for axis in scene.axes]
    variance = learned.variance
    return SweepLocalizer(
        scene,
        GridFilter(scene, mixture.cell, mixture.log_components, mixture.channels),
        mixture,
        SlowResidual(variance.correlation_length, variance.white_share),
        Convergence(ConvergenceCriteria(np.array(radius))),
        update_distance,
        registration,
    )
