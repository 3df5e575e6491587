"""The filter node's parameters: the localizer's configuration under its own names, and the node's."""

from __future__ import annotations

import dataclasses
from typing import Any

from tactile_localizer.core.configuration import (
    FILTERS,
    MODELS,
    PRECISIONS,
    RANGES,
    Configuration,
)
from tactile_localizer.core.filters.resampling import RESAMPLERS
from tactile_localizer.core.geometry.pose_buffer import DEFAULT_MAX_GAP_S
from tactile_localizer.core.geometry.synchronization import DEFAULT_PATIENCE_S
from tactile_localizer.core.likelihood.kernels.sums import EVALUATIONS
from tactile_localizer.ros.base.parameters import Parameter, Parameters
from tactile_localizer.ros.parameters import palm_pose

_DEFAULTS = Configuration()


def _choice(name: str, description: str, choices: Any) -> Parameter:
    return Parameter(name, getattr(_DEFAULTS, name), description, choices=tuple(choices))


def _number(name: str, description: str, unit: str = "", live: bool = False) -> Parameter:
    lower, upper = RANGES[name]
    return Parameter(name, getattr(_DEFAULTS, name), description, unit, lower, upper, live=live)


def _plain(name: str, description: str) -> Parameter:
    return Parameter(name, getattr(_DEFAULTS, name), description)


CONFIGURATION = (
    _plain(
        "model",
        f"Measurement model: {', '.join(MODELS)}, or one's own as module:Class. "
        "sweep_mixture is learned from the scan; the others use the scene's kernel widths, or choose some",
    ),
    _choice("filter", "Bayes filter: particles, or the exact recursion on a grid", FILTERS),
    _number("particles", "Number of particles; the paper has 75. Without effect unless filter is particle"),
    _number(
        "cell",
        "Resolution of the map and of the grid, in spacings of the scan's sweeps. Without effect on scenes "
        "of one axis, which have 0.5 mm",
    ),
    _choice(
        "evaluation",
        "Evaluation of kernel sums, of models sum_of_gaussians and featureless",
        EVALUATIONS,
    ),
    _choice("precision", "Precision of kernel sums, of models sum_of_gaussians and featureless", PRECISIONS),
    _plain("conditional", "Conditional form of model sum_of_gaussians; false: the paper's joint form"),
    _choice("resampling", "Resampling scheme. Without effect unless filter is particle", RESAMPLERS),
    _number(
        "resample_below",
        "Resample when the effective sample size falls below this share of the particles. Without effect "
        "unless filter is particle",
    ),
    _number(
        "random_particles",
        "Particles replaced by uniformly random ones at each update; the paper has 10. Expects filter "
        "particle",
    ),
    _number("update_distance", "Travel between two measurement updates", "m", live=True),
    _number(
        "convergence_radius", "Distance from the estimate within which the palm has to be", "m", live=True
    ),
    _number(
        "convergence_yaw_radius",
        "The same for yaw, where the scene has it",
        "rad",
        live=True,
    ),
    _number(
        "convergence_probability",
        "Probability of being on the map and within the radius, above which the position has converged",
        live=True,
    ),
    _number("convergence_travel", "Travel over which that probability must hold", "m", live=True),
)
"""One parameter for each field of :class:`~tactile_localizer.core.configuration.Configuration`."""

LIVE = frozenset(parameter.name for parameter in CONFIGURATION if parameter.live)
"""Of these, those that may change while the belief is kept."""

PARAMETERS = (
    Parameter("scan_file", "", "Scan file: the map"),
    Parameter("scene_file", "", "Scene (YAML) in place of the scan file's: a path, or a shipped one's name"),
    Parameter(
        "candidate_scan_files",
        [],
        "Scan files of several materials, in place of scan_file, to identify which one it is",
    ),
    Parameter("scan_directory", "", "Directory that ~/load_scan may read scan files from; empty: none"),
    *CONFIGURATION,
    Parameter("seed", 0, "Seed of the particle filter", lower=0),
    Parameter(
        "max_gap_s", DEFAULT_MAX_GAP_S, "Poses farther apart in time are not interpolated", "s", 0.0, 10.0
    ),
    Parameter(
        "patience_s",
        DEFAULT_PATIENCE_S,
        "Time, by stamps, that a strain waits for a late pose",
        "s",
        0.0,
        60.0,
    ),
    Parameter("stale_timeout_s", 0.5, "Age at which a position is stale", "s", 0.01, 60.0, live=True),
    Parameter(
        "particles_rate_hz",
        10.0,
        "Highest rate of ~/particles and ~/markers, by stamps",
        "Hz",
        0.1,
        1000.0,
        live=True,
    ),
    Parameter("shown_particles", 500, "Largest number of points in ~/particles", "", 1, 1_000_000, live=True),
    *palm_pose.PARAMETERS,
    Parameter(
        "publish_tf",
        False,
        "Publish the transform from reference_frame to material_frame that a converged posterior implies",
    ),
)


def configuration(parameters: Parameters) -> Configuration:
    """The localizer's configuration.

    Raises
    ------
    ParameterError
        Values that are in range, but do not go together.
    """
    return Configuration.from_mapping({name: parameters[name] for name in _names()})


def _names() -> list[str]:
    return [field.name for field in dataclasses.fields(Configuration)]
