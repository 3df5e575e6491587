"""From a scan, a scene and a configuration to a localizer that is ready to be fed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from tactile_localizer.core.bayes_filter import BayesFilter
from tactile_localizer.core.calibration.sweep_assembly import build_sweep_localizer
from tactile_localizer.core.configuration import MODELS, SWEEP_MIXTURE, Configuration
from tactile_localizer.core.convergence import Convergence, ConvergenceCriteria
from tactile_localizer.core.correlation import Correlation
from tactile_localizer.core.fit import held_out_fit
from tactile_localizer.core.grid_filter import GridFilter
from tactile_localizer.core.identification import FeatureIdentifier
from tactile_localizer.core.likelihood.base import MeasurementModel
from tactile_localizer.core.likelihood.featureless import Featureless
from tactile_localizer.core.likelihood.gaussian import Gaussian
from tactile_localizer.core.likelihood.sum_of_gaussians import SumOfGaussians
from tactile_localizer.core.likelihood.user_defined import SEPARATOR, build_own_model
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.naming import Namer, disagreement
from tactile_localizer.core.null_model import NullModel
from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.core.particle_filter import ParticleFilter
from tactile_localizer.core.phalanx_health import PhalanxHealth
from tactile_localizer.core.recovery import Recovery
from tactile_localizer.core.region_confidence import with_region
from tactile_localizer.core.scan.between_sweeps import with_interpolated_sweeps
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.selection import choose_parameters
from tactile_localizer.core.sweep_offset import SweepOffset
from tactile_localizer.errors import ParameterError
from tactile_localizer.scene import Scene

Progress = Callable[[str, float], None]


def build_localizer(
    scan: Scan,
    scene: Scene,
    configuration: Configuration,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> Localizer:
    """A localizer over ``scene``, with what the scene leaves open chosen from the scan.

    Parameters
    ----------
    scan : the training pairs
    scene : what is modelled
    configuration : model, filter and how much work
    rng : the only source of randomness
    progress : told what is being done, and which share of it is done, where parameters have to be chosen

    Raises
    ------
    SceneError
        The scene and the scan do not fit together.
    ParameterError
        A parameter out of its range.
    """
    if configuration.model == SWEEP_MIXTURE:
        return build_sweep_localizer(scan, scene, configuration.update_distance, configuration.cell, progress)
    scene = completed(scan, scene, progress)
    parameters = ModelParameters.from_mapping(scene.measurement)
    scan, offset = _without_offsets(scan, scene, parameters)
    return _assembled(scan, scene, configuration, parameters, offset, rng)


def build_identifier(
    candidates: Mapping[str, tuple[Scan, Scene]],
    configuration: Configuration,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> FeatureIdentifier:
    """Localizers for several scans, by name, whose evidence can be compared.

    A narrower kernel promises a higher density whether or not it is right, so all candidates share the widest
    of their kernel widths and the longest of their correlation lengths.
    """
    if configuration.model == SWEEP_MIXTURE:
        raise ParameterError(f"model: expected one that identifies, {', '.join(MODELS)}, got {SWEEP_MIXTURE}")
    scenes = {name: completed(scan, scene, progress) for name, (scan, scene) in candidates.items()}
    chosen = [ModelParameters.from_mapping(scene.measurement) for scene in scenes.values()]
    common = ModelParameters(
        position_std=np.max([parameters.position_std for parameters in chosen], axis=0),
        strain_std=np.max([parameters.strain_std for parameters in chosen], axis=0),
        correlation_length=max(float(parameters.correlation_length or 0.0) for parameters in chosen),
        correlation_change=_largest([parameters.correlation_change for parameters in chosen]),
        interpolate=any(parameters.interpolate for parameters in chosen),
        sweep_offset=all(parameters.sweep_offset for parameters in chosen),
        neighbours=max(parameters.neighbours for parameters in chosen),
    )
    localizers, scans = {}, {}
    for name, scene in scenes.items():
        scans[name], offset = _without_offsets(candidates[name][0], scene, common)
        scene = with_parameters(scene, common)
        localizers[name] = _assembled(scans[name], scene, configuration, common, offset, rng)
    covariance = disagreement((scan, scenes[name]) for name, scan in scans.items())
    namers = {
        name: Namer(scan, scenes[name], common.position_std, covariance) for name, scan in scans.items()
    }
    return FeatureIdentifier(localizers, namers)


def convergence_criteria(scene: Scene, configuration: Configuration) -> ConvergenceCriteria:
    """When the position may be believed, for the axes of ``scene``."""
    by_axis = {axis.name: configuration.convergence_std for axis in scene.axes}
    if "yaw" in by_axis:
        by_axis["yaw"] = configuration.convergence_yaw_std
    return ConvergenceCriteria(
        np.array(list(by_axis.values())), configuration.convergence_evidence, configuration.convergence_travel
    )


def completed(scan: Scan, scene: Scene, progress: Progress | None = None) -> Scene:
    """The scene with what it leaves open chosen from the scan: the feature's region and the parameters.

    A region is taken where the scan confirms one, and parameters are chosen for it.
    """
    scene = with_region(scan, scene)
    given = ModelParameters.from_mapping(scene.measurement)
    if given.complete:
        return scene
    return with_parameters(scene, given.filled_from(choose_parameters(scan, scene, progress)))


def build_model(
    scan: Scan, scene: Scene, configuration: Configuration, parameters: ModelParameters
) -> MeasurementModel:
    """The measurement model that ``configuration`` names."""
    if SEPARATOR in configuration.model:
        return build_own_model(configuration.model, scan, scene, parameters)
    common: dict[str, Any] = {"evaluation": configuration.evaluation, "precision": configuration.precision}
    widths = (parameters.position_std, parameters.strain_std)
    if configuration.model == "sum_of_gaussians":
        if parameters.interpolate:
            scan = with_interpolated_sweeps(scan, scene)
        return SumOfGaussians(scan, scene, *widths, conditional=configuration.conditional, **common)
    if configuration.model == "featureless":
        return Featureless(scan, scene, *widths, **common)
    return Gaussian(
        scan, scene, parameters.neighbours, independent=configuration.model == "gaussian_independent"
    )


def _without_offsets(
    scan: Scan, scene: Scene, parameters: ModelParameters
) -> tuple[Scan, SweepOffset | None]:
    """The scan as its map is to hold it, and what removes the offset of a new sweep likewise."""
    if not parameters.sweep_offset:
        return scan, None
    offset = SweepOffset(scan, scene)
    return offset.removed_from(scan, scene), offset


def _assembled(
    scan: Scan,
    scene: Scene,
    configuration: Configuration,
    parameters: ModelParameters,
    offset: SweepOffset | None,
    rng: np.random.Generator,
) -> Localizer:
    """A localizer, nothing being left to choose."""
    model = build_model(scan, scene, configuration, parameters)
    unknown = held_out_fit(scan, scene, lambda rest: build_model(rest, scene, configuration, parameters))
    widths = _widths(scene, parameters)
    null = NullModel.of_scan(scan, scene, widths, unknown, model.blur)
    return Localizer(
        scene,
        _build_filter(scene, model, configuration, parameters, rng),
        null,
        Convergence(convergence_criteria(scene, configuration)),
        Recovery() if configuration.recovery == "evidence" else None,
        PhalanxHealth(scene, model, null),
        configuration.update_distance,
        Correlation(
            float(parameters.correlation_length or 0.0), parameters.correlation_change, widths, scene.layout
        ),
        offset,
    )


def _widths(scene: Scene, parameters: ModelParameters) -> np.ndarray:
    """Kernel widths in strain, one a channel: (C,), V."""
    return np.broadcast_to(parameters.strain_std, scene.layout.size)


def _largest(changes: list[float | None]) -> float | None:
    """The change that says least; none does where it says nothing for one."""
    known = [change for change in changes if change is not None]
    return max(known) if len(known) == len(changes) else None


def _build_filter(
    scene: Scene,
    model: MeasurementModel,
    configuration: Configuration,
    parameters: ModelParameters,
    rng: np.random.Generator,
) -> BayesFilter:
    if configuration.filter == "grid":
        return GridFilter(
            scene, model, configuration.cell * np.broadcast_to(parameters.position_std, scene.dimension)
        )
    return ParticleFilter(
        scene,
        model,
        rng,
        particles=configuration.particles,
        resampling=configuration.resampling,
        resample_below=configuration.resample_below,
        random_particles=configuration.random_particles if configuration.recovery == "constant" else 0,
        adaptive=configuration.adaptive,
    )


def with_parameters(scene: Scene, parameters: ModelParameters) -> Scene:
    """The scene with ``parameters`` written into it, so that nothing is left to choose."""
    return dataclasses.replace(scene, measurement=parameters.to_mapping())
