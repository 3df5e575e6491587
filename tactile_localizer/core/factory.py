"""From a scan, a scene and a configuration to a localizer that is ready to be fed."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.calibration.examination import UNEXAMINED, examine, examine_position
from tactile_localizer.core.calibration.registration import registration_std
from tactile_localizer.core.calibration.sweep_model import (
    SweepModel,
    learn_sweep_model,
    learn_sweep_models,
)
from tactile_localizer.core.configuration import SWEEP_MIXTURE, Configuration
from tactile_localizer.core.filters.base import BayesFilter
from tactile_localizer.core.filters.grid import GridFilter
from tactile_localizer.core.filters.particle import ParticleFilter
from tactile_localizer.core.geometry.anchors import Anchors
from tactile_localizer.core.geometry.surroundings import surroundings
from tactile_localizer.core.hypotheses.convergence import Convergence, ConvergenceCriteria
from tactile_localizer.core.likelihood.base import MeasurementModel
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.core.likelihood.user_defined import NamedModel
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.measurements import Measurements
from tactile_localizer.core.plausibility import still_travel
from tactile_localizer.core.scan.range import ScanRange
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene

Progress = Callable[[str, float], None]

_EXAMINED = Configuration()
_COARSER = 2.0
"""Configuration of the localizers that examine a scan, and the size of their cells by the usual one: the
choice is the same, sooner."""

LEARNED = 0.9
"""Part of the progress of a localizer after which all is learned from the scan, and the map is built."""


def build_localizer(
    scan: Scan,
    scene: Scene,
    configuration: Configuration,
    rng: np.random.Generator,
    progress: Progress | None = None,
    calibration: Calibration | None = None,
) -> Localizer:
    """A localizer over ``scene``, with what the scene leaves open learned from the scan.

    Parameters
    ----------
    scan : the training pairs
    scene : what is modelled
    configuration : model, filter and how much work
    rng : the only source of randomness
    progress : called with a description of the step and its completed fraction
    calibration : of an earlier :func:`learn` from the same scan and scene; ``None``: learned here

    Raises
    ------
    SceneError
        The scene and the scan do not fit together.
    ParameterError
        A parameter out of its range.
    """
    say = progress or _silent
    scene = surroundings(scene, scan.positions_on(scene))
    learned = None
    if calibration is None:
        calibration, learned = _calibrated(scan, scene, say)
    say("building the map", LEARNED)
    learned = learned or learn_sweep_model(scan, scene, calibration.material, calibration.variance)
    position_model = _position_model(scan, scene, configuration, learned, calibration, say)
    prepared = _prepared(learned, scene, configuration, scan, still_travel(scan, scene))
    localizer = assemble(prepared, configuration, calibration, rng, position_model)
    say("ready", 1.0)
    return localizer


class Prepared(NamedTuple):
    """What a localizer needs of a scan, so that it can be kept for the next start.

    Parameters
    ----------
    scene : around the scan
    cell : (d,) m (yaw: rad), size of the filter's cells
    mixture : measurement model for these cells
    bounds : range of the scan
    still : (C,) m, travel over which its channels repeat their strain
    """

    scene: Scene
    cell: np.ndarray
    mixture: SweepMixture
    bounds: ScanRange
    still: np.ndarray


def prepare(
    scan: Scan,
    scene: Scene,
    configuration: Configuration,
    calibration: Calibration,
    learned: SweepModel | None = None,
) -> Prepared:
    """What :func:`assemble` needs of a scan, with the arguments of :func:`build_localizer`.

    ``learned`` is the model of :func:`learn_model`; ``None``: it is learned here.
    """
    scene = surroundings(scene, scan.positions_on(scene))
    learned = learned or learn_sweep_model(scan, scene, calibration.material, calibration.variance)
    return _prepared(learned, scene, configuration, scan, still_travel(scan, scene))


def _prepared(
    learned: SweepModel, scene: Scene, configuration: Configuration, scan: Scan, still: np.ndarray
) -> Prepared:
    cell = learned.cell(scene, configuration.cell)
    return Prepared(scene, cell, learned.mixture(scene, cell), ScanRange.of(scan, scene), still)


def _to_examine(
    learned: SweepModel, without: Sequence[np.ndarray], scene: Scene, scan: Scan, still: np.ndarray
) -> list[Prepared]:
    """The same in coarser cells, each with a map without some of the tracks (S,) bool."""
    cell, bounds = learned.cell(scene, _EXAMINED.cell, _COARSER), ScanRange.of(scan, scene)
    models = learned.mixtures(scene, cell, without)
    return [Prepared(scene, cell, model, bounds, still) for model in models]


def assemble(
    prepared: Prepared,
    configuration: Configuration,
    calibration: Calibration,
    rng: np.random.Generator,
    position_model: tuple[MeasurementModel, float] | None = None,
) -> Localizer:
    """A localizer, with the arguments of :func:`build_localizer`.

    Parameters
    ----------
    prepared : made with the same ``configuration.cell``
    configuration, calibration, rng : of the localizer
    position_model : another model for the position, and its travel per independent measurement, m
    """
    scene, mixture = prepared.scene, prepared.mixture
    examination = calibration.examination
    model, information_length = position_model or (None, examination.information_length)
    return Localizer(
        scene,
        _build_filter(scene, configuration, prepared.cell, rng),
        mixture,
        model,
        Convergence(convergence_criteria(scene, configuration)),
        Measurements(
            scene,
            mixture.noise.white,
            mixture.noise.variance,
            prepared.bounds,
            prepared.still,
            configuration.update_distance,
        ),
        information_length,
        examination.explanation_length,
        calibration.registration_std,
        Anchors(scene),
    )


def _calibrated(scan: Scan, scene: Scene, say: Progress) -> tuple[Calibration, SweepModel]:
    """What the examination of the scan shows, and the model of the kind that it chooses."""
    prior, still, begun = registration_std(scene), still_travel(scan, scene), 0.2 * LEARNED
    say("learning the noise", 0.0)
    # Of the level of a single sweep nothing is known.
    kinds = list(Material) if len(scan.sweep_numbers) > 1 else [Material.CLOTH]
    models = learn_sweep_models(scan, scene, kinds)

    def build(model: SweepModel, without: Sequence[np.ndarray], within: Scene) -> list[Localizer]:
        before = Calibration(prior, model.scan.material, model.variance)
        prepared = _to_examine(model, without, within, scan, still)
        return [assemble(each, _EXAMINED, before, np.random.default_rng(0)) for each in prepared]

    say("examining the scan by held-out sweeps", begun)
    chosen, examination = examine(
        scan,
        models,
        build,
        lambda done: say("examining the scan by held-out sweeps", begun + (LEARNED - begun) * done),
    )
    model = models[chosen]
    right = [each for each in examination.on_map if each.right]
    calibration = Calibration(
        registration_std(scene, right), model.scan.material, model.variance, examination
    )
    return calibration, model


def learn(scan: Scan, scene: Scene, progress: Progress | None = None) -> Calibration:
    """What :func:`build_localizer` would learn in seconds, to be kept with the scan.

    The progress is a part of that of :func:`build_localizer`, which continues it.
    """
    return learn_model(scan, scene, progress)[0]


def learn_model(scan: Scan, scene: Scene, progress: Progress | None = None) -> tuple[Calibration, SweepModel]:
    """What :func:`learn` does, and the model of the sweeps, for :func:`prepare`."""
    return _calibrated(scan, surroundings(scene, scan.positions_on(scene)), progress or _silent)


def convergence_criteria(scene: Scene, configuration: Configuration) -> ConvergenceCriteria:
    """Thresholds of convergence for the axes of ``scene``."""
    radius = [
        configuration.convergence_yaw_radius if axis.name == "yaw" else configuration.convergence_radius
        for axis in scene.axes
    ]
    return ConvergenceCriteria(
        np.array(radius), configuration.convergence_probability, configuration.convergence_travel
    )


def _silent(_doing: str, _done: float) -> None:
    """Report nothing."""


def _position_model(
    scan: Scan,
    scene: Scene,
    configuration: Configuration,
    learned: SweepModel,
    calibration: Calibration,
    say: Progress,
) -> tuple[MeasurementModel, float] | None:
    """Model for the position, and its travel per independent measurement, m; ``None``: the default model.

    Raises
    ------
    ParameterError
        There is no such model, it cannot be made, or its ``information_length`` is not positive.
    """
    name = configuration.model
    if name == SWEEP_MIXTURE:
        return None
    without, still = _without_levels(scan, scene, learned.scan.levels), still_travel(scan, scene)
    model = NamedModel(name, without, scene)
    if model.gives_length:
        return model, model.information_length

    def build(learned: SweepModel, out: Sequence[np.ndarray], within: Scene) -> list[Localizer]:
        prepared = _to_examine(learned, out, within, scan, still)
        kept = [np.isin(scan.sweep, scan.sweep_numbers[~tracks]) for tracks in out]
        parts = [NamedModel(name, without.select(rows), scene) for rows in kept]
        return [
            assemble(each, _EXAMINED, calibration, np.random.default_rng(0), (part, UNEXAMINED))
            for each, part in zip(prepared, parts, strict=True)
        ]

    doing = f"examining {name} by held-out sweeps"
    say(doing, LEARNED)
    return model, examine_position(
        scan,
        learned,
        build,
        calibration.examination.explanation_length,
        lambda done: say(doing, LEARNED + (1.0 - LEARNED) * done),
    )


def _without_levels(scan: Scan, scene: Scene, levels: np.ndarray) -> Scan:
    """The scan without the levels (S, C), V, of its sweeps."""
    strain = scan.strain.copy()
    channels = scene.channels(scan.phalanges, scan.channels)
    index = np.searchsorted(scan.sweep_numbers, scan.sweep)
    strain[:, channels] -= levels[index]
    return replace(scan, strain=strain)


def _build_filter(
    scene: Scene, configuration: Configuration, cell: np.ndarray, rng: np.random.Generator
) -> BayesFilter:
    if configuration.filter == "grid":
        return GridFilter(scene, cell)
    return ParticleFilter(
        scene,
        rng,
        particles=configuration.particles,
        resample_below=configuration.resample_below,
        random_particles=configuration.random_particles,
    )
