"""How far the positions of one sweep are from those of another, from sweeps that are held out of the map."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tactile_localizer.core.calibration.sweep_model import SweepModel
from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Scene

_MOST_SWEEPS = 5
"""Sweeps that are held out, one after another: each takes a new map."""


def registration_std(
    scan: Scan, scene: Scene, model: SweepModel, localizer: Callable[[SweepMixture], Localizer]
) -> np.ndarray:
    """Standard deviation (d,), m (yaw: rad), of what the filter's covariance leaves out.

    Fingers flex, material stretches and recordings begin late: where one sweep felt a place, another feels
    it a little further on. Each held-out sweep is localized on the map of the others, without its neighbour
    where there are enough, because neighbours are alike beyond chance. What its squared error exceeds the
    filter's variance by is the variance of the registration, at least what the distance between two samples
    leaves open.

    Parameters
    ----------
    model : learned from the scan
    localizer : makes one of a mixture, without registration
    """
    sweeps = scan.sweep_numbers
    states = scan.states[:, scene.columns(scan.axes)]
    strain = scan.strain[:, scene.channels(scan.phalanges, scan.channels)]
    steps = [np.abs(np.diff(states[scan.sweep == number], axis=0)) for number in sweeps]
    sampling = (
        np.median(np.concatenate(steps), axis=0) if len(scan) > len(sweeps) else np.zeros(len(scene.axes))
    )
    count = len(sweeps)
    least = sampling**2 / 12.0 * (1.0 + 1.0 / count)
    if count < 2:
        return np.asarray(np.sqrt(least))
    chosen = np.unique(np.linspace(0, count - 1, min(count, _MOST_SWEEPS) + 2)[1:-1].round().astype(int))
    if count <= _MOST_SWEEPS:
        chosen = np.arange(count)
    excess = []
    for index in chosen:
        without = (int(index), int(index) + 1) if count > 3 and index + 1 < count else (int(index),)
        held_out = localizer(model.mixture(scene, 1.0 / 3.0, without))
        rows = np.flatnonzero(scan.sweep == sweeps[index])
        measured = _excess(held_out, states[rows], strain[rows], scene)
        if measured is not None:
            excess.append(measured)
    if not excess:
        return np.asarray(np.sqrt(least))
    # A sweep against the mean of all of them, from sweeps against the mean of the others.
    scale = (1.0 + 1.0 / count) / (1.0 + 1.0 / (count - 1))
    return np.asarray(np.sqrt(np.maximum(scale * np.mean(excess, axis=0), least)))


def _excess(localizer: Localizer, states: np.ndarray, strain: np.ndarray, scene: Scene) -> np.ndarray | None:
    """Mean squared error less variance (d,) of the strains that are localized; ``None`` where none is."""
    localizer.reset()
    errors, variances = [], []
    for index, (state, each) in enumerate(zip(states, strain, strict=True)):
        estimate = localizer.update(10_000_000 * index, state, each)
        if estimate.updated and estimate.converged:
            error = estimate.mean - state
            errors.append(np.where(scene.wraps, wrap_angle(error), error))
            variances.append(np.diag(estimate.covariance))
    if len(errors) < 3:
        return None
    return np.asarray(np.mean(np.square(errors) - variances, axis=0))
