"""Kernel widths of the paper's models, by the density of held-out strains at their true positions.

The paper sets S_x and S_z by hand (III-C). Among the candidates whose held-out density is within one standard
error of the best, the widest in strain is chosen, because wide kernels are cautious.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from tactile_localizer.core.likelihood.base import MeasurementModel
from tactile_localizer.core.likelihood.sum_of_gaussians import SumOfGaussians
from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.core.scan.between_sweeps import with_interpolated_sweeps
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.spacing import base_widths, divided
from tactile_localizer.scene import Scene

POSITION_FACTORS = (0.25, 0.5, 1.0)
STRAIN_FACTORS = (0.35, 0.5, 0.7, 1.0, 1.4)
"""Candidates, as factors of the two :func:`.base_widths`."""
_SWEEPS = 4
_SAMPLES = 60
"""Numbers of held-out sweeps, and of strains in each."""
_TYPICAL_FACTORS = 0.5, 0.7
"""Factors that are usually chosen."""
_STRAIN_LOSS = 1.0
"""Largest accepted loss of held-out log-density, nats per channel: reached with a strain width three times
too large or half as large as it should be. By judgement."""
_POSITION_LOSS = 2.0
"""Largest accepted loss through the position width, nats, at the 0.9 quantile of the strains: reached at four
sweep spacings on simulated bumps and snaps. By judgement."""


def choose_kernel_widths(scan: Scan, scene: Scene, given: ModelParameters) -> ModelParameters:
    """Complete the given parameters by the widths that are ``None``."""
    position, strain = base_widths(scan, scene)
    positions, strains = [given.position_std], [given.strain_std]
    if given.position_std is None:
        positions = [position * factor for factor in POSITION_FACTORS]
    if given.strain_std is None:
        strains = [strain * factor for factor in STRAIN_FACTORS]
    candidates = list(product(positions, strains))

    def build(rest: Scan, widths: tuple[np.ndarray, np.ndarray]) -> MeasurementModel:
        between = rest if given.interpolate is False else with_interpolated_sweeps(rest, scene)
        return SumOfGaussians(between, scene, *widths, precision="float32")

    rows = np.arange(len(scan))
    models = [partial(build, widths=widths) for widths in candidates]
    scores = np.array([held_out_log_densities(scan, scene, rows, model) for model in models])
    best = int(scores.mean(axis=1).argmax())
    loss = scores[best] - scores
    cautious = loss.mean(axis=1) <= loss.std(axis=1) / np.sqrt(scores.shape[1])
    widest = max(np.flatnonzero(cautious), key=lambda index: float(np.sum(candidates[index][1])))
    return replace(given, position_std=candidates[widest][0], strain_std=candidates[widest][1])


def describe_unfit_widths(scan: Scan, scene: Scene) -> str | None:
    """Warning where the kernel widths in ``scene`` do not fit the scan; ``None`` where they do.

    Under the given widths, the strains of held-out sweeps must be about as probable as under typical widths.
    """
    parameters = ModelParameters.of_scene(scene)
    given = {"position_std": parameters.position_std, "strain_std": parameters.strain_std}
    if all(width is None for width in given.values()):
        return None
    typical = [
        width * factor for width, factor in zip(base_widths(scan, scene), _TYPICAL_FACTORS, strict=True)
    ]
    position, strain = (
        default if width is None else width for width, default in zip(given.values(), typical, strict=True)
    )

    def held_out(position_std: object, strain_std: object) -> np.ndarray:
        build = partial(SumOfGaussians, scene=scene, position_std=position_std, strain_std=strain_std)
        densities = held_out_log_densities(scan, scene, np.arange(len(scan)), build)
        return np.nan_to_num(densities, nan=-1e9, posinf=1e9, neginf=-1e9)

    reference = held_out(*typical)
    loss = float(np.mean(reference - held_out(position, strain)))
    by_position = float(np.quantile(reference - held_out(position, typical[1]), 0.9))
    if loss <= _STRAIN_LOSS * scene.layout.size and by_position <= _POSITION_LOSS:
        return None
    units = ("m", "V")
    found = ", ".join(
        f"{name} {_plain(width)} {unit}"
        for (name, width), unit in zip(given.items(), units, strict=True)
        if width is not None
    )
    expected = ", ".join(
        f"{name} {_plain(np.median(width))} {unit}"
        for name, width, unit in zip(given, typical, units, strict=True)
    )
    return (
        f"measurement of scene {scene.name}: expected kernel widths that fit the scan's held-out strains "
        f"(about {expected}), found {found}: strains are {min(max(loss, by_position), 1e6):.0f} nats "
        "less probable; omitted widths are chosen from the scan"
    )


def _plain(value: object) -> str:
    values = np.atleast_1d(np.asarray(value, dtype=np.float64))
    return f"{values[0]:.2g}" if len(values) == 1 else f"[{values.min():.2g} to {values.max():.2g}]"


def held_out_log_densities(
    scan: Scan, scene: Scene, rows: np.ndarray, build: Callable[[Scan], MeasurementModel]
) -> np.ndarray:
    """Log-densities (M,), nats, of strains at their true positions under a map without their sweep.

    Parameters
    ----------
    scan, scene : training pairs and scene
    rows : indices of the pairs of interest, of which up to 60 from each of up to 4 sweeps are used
    build : makes the measurement model from a scan without one sweep
    """
    positions, strain = scan.positions_on(scene), scan.strain_on(scene)
    sweep = divided(scan.sweep)
    numbers = np.unique(sweep[rows])
    found = []
    for number in numbers[_spread(len(numbers), _SWEEPS)]:
        own = rows[sweep[rows] == number]
        model = build(scan.select(sweep != number))
        for row in own[_spread(len(own), _SAMPLES)]:
            found.append(model.log_likelihood(positions[row : row + 1], strain[row])[0])
    return np.array(found)


def _spread(count: int, most: int) -> np.ndarray:
    """Up to ``most`` of ``count`` indices, evenly spread."""
    return np.unique(np.linspace(0, max(count - 1, 0), min(count, most)).astype(int))
