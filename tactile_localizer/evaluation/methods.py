"""What is compared: the default, the presets, the paper's models as it has them and with the exact filter."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from tactile_localizer.core.configuration import MODELS, Configuration
from tactile_localizer.io.configuration_file import PRESETS, load_configuration

_SQUARE_INCH = 0.0254**2

PAPER_FILTER: dict[str, Any] = {
    "filter": "particle",
    "particles": 75,
    "recovery": "constant",
    "random_particles": 10,
    "resample_below": 1.0,
    "conditional": False,
}
"""The paper's particle filter (III-B): 75 particles, resampled at each update, 10 of them random."""

PAPER_PARAMETERS = {
    "position_std": math.sqrt(0.0075 * _SQUARE_INCH),
    "strain_std": math.sqrt(0.001),
    "correlation_length": Configuration().update_distance,
    "interpolate": False,
    "sweep_offset": False,
}
"""The paper's hand-set widths (III-C) in m and V; each strain counts in full, as it is."""

PARTICLES = (75, 1000)
"""The paper's number, and one that should come close to the exact filter."""

PAPER_NEIGHBOURS = 8
"""k of the paper's Gaussian models (Fig. 6)."""


SCENE, TUNED = "scene", "tuned"
"""Where parameters of the measurement model come from: the scene, or the scan alone as ``tune`` does it."""


@dataclass(frozen=True)
class Method:
    """A configuration under a name.

    Parameters
    ----------
    name : for tables and figures
    configuration : choices of the user
    measurement : parameters of the measurement model that go before those of ``parameters``
    parameters : :data:`SCENE` or :data:`TUNED`
    """

    name: str
    configuration: Configuration
    measurement: dict[str, Any] = field(default_factory=dict)
    parameters: str = SCENE


def paper_form(model: str) -> str:
    """Name of the method that is a model as the paper has it."""
    return f"{model}-paper"


def exact_form(model: str) -> str:
    """Name of the method that is the same model and parameters with the exact filter."""
    return f"{model}-paper-grid"


def exact_of(method: Method) -> str:
    """Name of the method that a method would be with the exact filter; its own where there is none other."""
    if method.name.endswith("-paper"):
        return f"{method.name}-grid"
    is_exact = method.name.endswith("-paper-grid")
    return method.name if is_exact or method.configuration.model != Configuration().model else "default"


def standard_methods() -> dict[str, Method]:
    """By name: the default, also with few and many particles, the presets, and the paper's models.

    Each of the paper's models is also there with the exact filter.
    """
    methods = [Method("default", Configuration())]
    methods += [
        Method(f"particles-{count}", Configuration(filter="particle", particles=count)) for count in PARTICLES
    ]
    methods.append(Method("featureless", Configuration(model="featureless")))
    methods += [Method(preset, load_configuration(preset)) for preset in PRESETS]
    for model in MODELS:
        methods.append(
            Method(paper_form(model), Configuration(model=model, **PAPER_FILTER), dict(PAPER_PARAMETERS))
        )
        # A Gaussian at every fine cell would take minutes a sweep; its neighbours change only between pairs.
        cell = 0.3 if model in ("sum_of_gaussians", "featureless") else 0.6
        exact = Configuration(model=model, filter="grid", cell=cell, conditional=False)
        methods.append(Method(exact_form(model), exact, dict(PAPER_PARAMETERS)))
    return {method.name: method for method in methods}


def tuning_methods() -> dict[str, Method]:
    """By name: parameters by data beside the paper's, for the default and for the single Gaussian.

    The paper counts every strain in full; *tempered* has its widths, but tempering by data. The Gaussians are
    both tempered by data and differ in the number of neighbours.
    """
    gaussian = Configuration(model="gaussian", filter="particle")
    widths = {name: PAPER_PARAMETERS[name] for name in ("position_std", "strain_std")}
    methods = [
        Method("tuned", Configuration(), parameters=TUNED),
        Method("hand-set", Configuration(), dict(PAPER_PARAMETERS), TUNED),
        Method("hand-set-tempered", Configuration(), widths, TUNED),
        Method("gaussian-tuned", gaussian, parameters=TUNED),
        Method("gaussian-hand-set", gaussian, {"neighbours": PAPER_NEIGHBOURS}, TUNED),
    ]
    return {method.name: method for method in methods}
