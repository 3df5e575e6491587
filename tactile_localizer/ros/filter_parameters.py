"""Parameters of the filter node: the configuration of the localizer, and those of the node itself."""

from tactile_localizer.core.configuration import FILTERS, RANGES, SWEEP_MIXTURE, Configuration
from tactile_localizer.ros.base.parameters import Parameter, Parameters
from tactile_localizer.ros.subscriptions.tactile_inputs import FRAMES, SYNCHRONIZATION

_DEFAULTS = Configuration()


_DESCRIPTIONS = {
    "model": f"Measurement model: {SWEEP_MIXTURE}, or another one for the position: module:Class, or a name",
    "filter": "Particle filter, or exact recursion on a grid",
    "particles": "Number of particles, 75 in the paper; for filter particle",
    "cell": "Resolution of map and grid, in distances between sweeps, unless the scene has one axis (0.5 mm) "
    "or three (at most 25,000 cells)",
    "resample_below": "Effective sample size, as a fraction of the particles, below which they are resampled",
    "random_particles": "Particles replaced by uniformly drawn ones at each update, 10 in the paper; "
    "for filter particle",
    "update_distance": "Travel between measurement updates",
    "convergence_radius": "Radius about the estimate that convergence refers to",
    "convergence_yaw_radius": "The same in yaw, if the scene has it",
    "convergence_probability": "Probability of being on the map and within the radius, above which the "
    "estimate has converged",
    "convergence_travel": "Travel over which that probability must be exceeded",
}
_UNITS = dict.fromkeys(("update_distance", "convergence_radius", "convergence_travel"), "m")
_UNITS["convergence_yaw_radius"] = "rad"

LIVE = frozenset(_UNITS) | {"convergence_probability"}
"""Names of the parameters of the localizer that can be changed without a reset of the belief."""


def _parameter(name: str) -> Parameter:
    """The parameter of a field of the configuration."""
    lower, upper = RANGES.get(name, (None, None))
    default, unit, choices = (
        getattr(_DEFAULTS, name),
        _UNITS.get(name, ""),
        FILTERS if name == "filter" else (),
    )
    return Parameter(
        name, default, _DESCRIPTIONS[name], unit, lower, upper, choices, name in LIVE, name == "model"
    )


CONFIGURATION = tuple(map(_parameter, _DESCRIPTIONS))
"""One parameter per field of :class:`~tactile_localizer.core.configuration.Configuration`."""

PARAMETERS = (
    Parameter("scan_file", "", "Scan (folder) that is the map", at_start=True),
    Parameter(
        "scene_file",
        "",
        "Scene (YAML) in place of the scan's: path or shipped file name",
        at_start=True,
    ),
    Parameter(
        "scan_directory",
        "",
        "Directory of the scans that ~/load_scan may read; if empty, none",
        at_start=True,
    ),
    *CONFIGURATION,
    Parameter("seed", 0, "Seed of the particle filter", "", 0, 2**31 - 1),
    *SYNCHRONIZATION,
    Parameter("stale_timeout_s", 0.5, "Age above which an estimate is stale", "s", 0.01, 60.0, live=True),
    Parameter(
        "particles_rate_hz",
        10.0,
        "Maximum rate of ~/particles and ~/markers, measured in stamps",
        "Hz",
        0.1,
        1000.0,
        live=True,
    ),
    Parameter("shown_particles", 500, "Maximum number of points in ~/particles", "", 1, 1_000_000, live=True),
    *FRAMES,
    Parameter(
        "publish_tf",
        False,
        "Publish material_frame in reference_frame while the estimate has converged",
    ),
)


def configuration(parameters: Parameters) -> Configuration:
    """The configuration of the localizer.

    Raises
    ------
    ParameterError
        Values in range, but inconsistent with each other.
    """
    return Configuration.from_mapping({name: parameters[name] for name in _DESCRIPTIONS})
