"""Methods to compare: the default, the presets and the paper's models."""

from __future__ import annotations

import math
from typing import Any

from evaluation.comparison import Method
from tactile_localizer.core.configuration import MODELS, SWEEP_MIXTURE, Configuration
from tactile_localizer.io.configuration_file import PRESETS, load_configuration

_SQUARE_INCH = 0.0254**2

PAPER_FILTER: dict[str, Any] = {
    "filter": "particle",
    "particles": 75,
    "max_particles": 75,
    "random_particles": 10,
    "resample_below": 1.0,
    "conditional": False,
}
"""The paper's particle filter (III-B): 75 particles, resampled at each update, 10 of them random."""

PAPER_PARAMETERS = {
    "position_std": math.sqrt(0.0075 * _SQUARE_INCH),
    "strain_std": math.sqrt(0.001),
    "correlation_length": Configuration().update_distance,
}
"""The paper's hand-set widths (III-C), m and V; no tempering, no interpolation."""

TENTH_INCH_MM = 2.54
"""Error after contact that the paper reports, mm."""

PAPER_MODELS = tuple(model for model in MODELS if model != SWEEP_MIXTURE)

PARTICLES = (75, 300, 1000)
"""Numbers of particles: the paper's, the default, and one that should approach the exact filter."""


def paper_form(model: str) -> str:
    """Name of the method with a model in the paper's form."""
    return f"{model}-paper"


def exact_form(model: str) -> str:
    """Name of the method with the same model and parameters, and the exact filter."""
    return f"{model}-paper-grid"


def exact_of(method: Method) -> str:
    """Name of the exact filter that a method approximates; its own name if it is exact."""
    if method.name.endswith("-paper"):
        return f"{method.name}-grid"
    return "default" if method.configuration.model == SWEEP_MIXTURE else method.name


def standard_methods() -> dict[str, Method]:
    """Standard methods by name: the default, also with few and many particles, presets, and kernel models.

    The kernel models have widths chosen from the scan; the paper's models have the paper's parameters, with
    its particle filter and with the exact filter.
    """
    methods = [Method("default", Configuration())]
    methods += [
        Method(f"particles-{count}", Configuration(filter="particle", particles=count)) for count in PARTICLES
    ]
    methods += [Method(preset, load_configuration(preset)) for preset in PRESETS]
    methods += [Method(model, Configuration(model=model)) for model in ("sum_of_gaussians", "featureless")]
    for model in PAPER_MODELS:
        methods.append(
            Method(paper_form(model), Configuration(model=model, **PAPER_FILTER), dict(PAPER_PARAMETERS))
        )
        # Gaussians on a fine grid would take minutes per sweep; their neighbours change only between pairs.
        cell = 0.3 if model in ("sum_of_gaussians", "featureless") else 0.6
        exact = Configuration(model=model, filter="grid", cell=cell, conditional=False)
        methods.append(Method(exact_form(model), exact, dict(PAPER_PARAMETERS)))
    return {method.name: method for method in methods}
