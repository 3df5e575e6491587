"""The filter node's parameters: the localizer's configuration under its own names, and the node's."""

from __future__ import annotations

import dataclasses
from typing import Any

from tactile_localizer.core.configuration import (
    FILTERS,
    MODELS,
    PRECISIONS,
    RANGES,
    RECOVERIES,
    SWEEP_MIXTURE,
    Configuration,
)
from tactile_localizer.core.filters.resampling import RESAMPLERS
from tactile_localizer.core.geometry.pose_buffer import DEFAULT_MAX_GAP_S
from tactile_localizer.core.geometry.synchronization import DEFAULT_PATIENCE_S
from tactile_localizer.core.likelihood.kernels.sums import EVALUATIONS
from tactile_localizer.nodes import palm_pose
from tactile_localizer.nodes.parameters import Parameter, Parameters

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
        "model", f"Measurement model: {', '.join((*MODELS, SWEEP_MIXTURE))}, or one's own as module:Class"
    ),
    _choice("filter", "Particles, or the exact recursion on the cells of a grid", FILTERS),
    _number("particles", "How many particles; the paper has 75"),
    _number("cell", "Largest cell of the grid, in widths of the position kernel"),
    _choice("evaluation", "How kernel sums are evaluated", EVALUATIONS),
    _choice("precision", "Of the strains in memory", PRECISIONS),
    _plain("conditional", "Sum of Gaussians in conditional form; false: the paper's joint form"),
    _choice("resampling", "Resampling scheme of the particle filter", RESAMPLERS),
    _number("resample_below", "Effective share of the particles below which they are resampled"),
    _plain("adaptive", "Choose the number of particles by KLD sampling, up to particles"),
    _choice(
        "recovery", "Spread a contradicted belief; constant: random_particles at each update", RECOVERIES
    ),
    _number("random_particles", "Of the constant recovery; the paper has 10"),
    _number("update_distance", "Travel between two weighed strains", "m", live=True),
    _number("convergence_std", "The belief is narrow below this standard deviation an axis", "m", live=True),
    _number("convergence_yaw_std", "The same for yaw", "rad", live=True),
    _number("convergence_evidence", "Evidence needed before the position may be believed", "nat", live=True),
    _number("convergence_travel", "Travel over which both must hold", "m", live=True),
)
"""One parameter for each field of :class:`~tactile_localizer.core.configuration.Configuration`."""

LIVE = frozenset(parameter.name for parameter in CONFIGURATION if parameter.live)
"""Of these, those that may change while the belief is kept."""

PARAMETERS = (
    Parameter("scan_file", "", "Scan file: the map"),
    Parameter("scene_file", "", "Scene (YAML) in place of the scan file's: a path, or a shipped one's name"),
    Parameter(
        "candidate_scan_files", [], "Scan files of several features, in place of scan_file: which is it?"
    ),
    Parameter("scan_directory", "", "Directory that ~/load_scan may read scan files from; empty: none"),
    *CONFIGURATION,
    Parameter("seed", 0, "Seed of everything random", lower=0),
    Parameter("max_gap_s", DEFAULT_MAX_GAP_S, "Poses further apart are not interpolated", "s", 0.0, 10.0),
    Parameter("patience_s", DEFAULT_PATIENCE_S, "Time, by stamps, to wait for a late pose", "s", 0.0, 60.0),
    Parameter("stale_timeout_s", 0.5, "Age at which a position is stale", "s", 0.01, 60.0, live=True),
    Parameter(
        "particles_rate_hz", 10.0, "Most ~/particles in a second, by stamps", "Hz", 0.1, 1000.0, live=True
    ),
    Parameter("shown_particles", 500, "Most points in ~/particles", "", 1, 1_000_000, live=True),
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
