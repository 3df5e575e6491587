"""Kernel widths for the paper's models, by the density of held-out strains at their true positions.

The paper specifies S_x and S_z by hand (III-C). Among the widths whose held-out density is within one
standard error of the best, the widest in strain are taken: wide kernels are cautious.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

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
"""Candidates: shares of the spacing of the sweeps, and of their disagreement."""
_SWEEPS = 4
_SAMPLES = 60
"""Held-out sweeps, and strains of each."""


def choose_kernel_widths(scan: Scan, scene: Scene, given: ModelParameters) -> ModelParameters:
    """The given parameters with the widths that they leave open."""
    position, strain = base_widths(scan, scene)
    rows = np.arange(len(scan))
    candidates, densities = [], []
    for position_factor in POSITION_FACTORS if given.position_std is None else (1.0,):
        for strain_factor in STRAIN_FACTORS if given.strain_std is None else (1.0,):
            widths = (
                position * position_factor if given.position_std is None else given.position_std,
                strain * strain_factor if given.strain_std is None else given.strain_std,
            )

            def build(rest: Scan, widths: tuple[np.ndarray, np.ndarray] = widths) -> MeasurementModel:
                between = rest if given.interpolate is False else with_interpolated_sweeps(rest, scene)
                return SumOfGaussians(between, scene, *widths, precision="float32")

            candidates.append(widths)
            densities.append(held_out_log_densities(scan, scene, rows, build)[1])
    scores = np.array(densities)
    best = int(scores.mean(axis=1).argmax())
    loss = scores[best] - scores
    cautious = loss.mean(axis=1) <= loss.std(axis=1) / np.sqrt(scores.shape[1])
    widest = max(np.flatnonzero(cautious), key=lambda index: float(np.sum(candidates[index][1])))
    return replace(given, position_std=candidates[widest][0], strain_std=candidates[widest][1])


def held_out_log_densities(
    scan: Scan, scene: Scene, rows: np.ndarray, build: Callable[[Scan], MeasurementModel]
) -> tuple[np.ndarray, np.ndarray]:
    """Log-densities of some strains at their true positions, each by a map without its sweep.

    Parameters
    ----------
    scan, scene : the training pairs and what is modelled
    rows : indices of the pairs of interest; up to 60 from each of up to 4 sweeps are tried
    build : makes the measurement model from a scan with one sweep left out

    Returns
    -------
    tried : (M,) indices of the pairs
    log_density : (M,) nats
    """
    columns, channels = scene.columns(scan.axes), scene.channels(scan.phalanges, scan.channels)
    sweep = divided(scan.sweep)
    numbers = np.unique(sweep[rows])
    tried, found = [], []
    for number in numbers[_spread(len(numbers), _SWEEPS)]:
        own = rows[sweep[rows] == number]
        model = build(scan.select(sweep != number))
        for row in own[_spread(len(own), _SAMPLES)]:
            tried.append(row)
            found.append(model.log_likelihood(scan.states[row, columns][None], scan.strain[row, channels])[0])
    return np.array(tried, dtype=np.intp), np.array(found)


def _spread(count: int, most: int) -> np.ndarray:
    """Up to ``most`` of ``count`` indices, evenly spread."""
    return np.unique(np.linspace(0, max(count - 1, 0), min(count, most)).astype(int))
