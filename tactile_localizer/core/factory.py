"""From a scan, a scene and a configuration to a localizer that is ready to be fed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tactile_localizer.core.calibration.held_out import calibrate
from tactile_localizer.core.calibration.sweep_model import learn_sweep_model
from tactile_localizer.core.configuration import SWEEP_MIXTURE, Configuration
from tactile_localizer.core.decision.convergence import Convergence, ConvergenceCriteria
from tactile_localizer.core.filters.base import BayesFilter
from tactile_localizer.core.filters.grid import GridFilter
from tactile_localizer.core.filters.particle import ParticleFilter
from tactile_localizer.core.likelihood.evaluation import StrainModel
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene

Progress = Callable[[str, float], None]


def build_localizer(
    scan: Scan,
    scene: Scene,
    configuration: Configuration,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> Localizer:
    """A localizer over ``scene``, with what the scene leaves open learned from the scan.

    Parameters
    ----------
    scan : the training pairs
    scene : what is modelled
    configuration : model, filter and how much work
    rng : the only source of randomness
    progress : called with what is being done and the fraction of it that is done

    Raises
    ------
    SceneError
        The scene and the scan do not fit together.
    ParameterError
        A parameter out of its range.
    """
    say = progress or (lambda _doing, _done: None)
    say("learning the noise", 0.0)
    learned = learn_sweep_model(scan, scene)
    say("calibrating on held-out sweeps", 0.3)

    def exact(mixture: SweepMixture) -> Localizer:
        grid = GridFilter(scene, mixture.cell)
        return _assembled(scene, configuration, grid, mixture, np.zeros(scene.dimension))

    calibration = calibrate(scan, scene, learned, exact)
    mixture = learned.mixture(scene, configuration.cell, calibration.information_length)
    model: StrainModel = mixture
    say("ready", 1.0)
    bayes_filter = _build_filter(scene, configuration, mixture.cell, rng)
    return _assembled(scene, configuration, bayes_filter, model, calibration.registration_std)


def convergence_criteria(scene: Scene, configuration: Configuration) -> ConvergenceCriteria:
    """Thresholds of convergence for the axes of ``scene``."""
    radius = [
        configuration.convergence_yaw_radius if axis.name == "yaw" else configuration.convergence_radius
        for axis in scene.axes
    ]
    return ConvergenceCriteria(
        np.array(radius), configuration.convergence_probability, configuration.convergence_travel
    )


def _assembled(
    scene: Scene,
    configuration: Configuration,
    bayes_filter: BayesFilter,
    model: StrainModel,
    registration: np.ndarray,
) -> Localizer:
    convergence = Convergence(convergence_criteria(scene, configuration))
    return Localizer(scene, bayes_filter, model, convergence, configuration.update_distance, registration)


def _build_filter(
    scene: Scene, configuration: Configuration, cell: np.ndarray, rng: np.random.Generator
) -> BayesFilter:
    if configuration.filter == "grid":
        return GridFilter(scene, cell)
    return ParticleFilter(
        scene,
        rng,
        particles=configuration.particles,
        resampling=configuration.resampling,
        resample_below=configuration.resample_below,
        random_particles=configuration.random_particles,
    )
