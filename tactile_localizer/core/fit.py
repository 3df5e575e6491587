"""How well the map explains sweeps that are not in it: the yardstick for material that was never scanned."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tactile_localizer.core.measurement import MeasurementModel
from tactile_localizer.core.scan import Scan
from tactile_localizer.core.selection import divided
from tactile_localizer.scene import Scene

QUANTILE = 0.05
_SWEEPS = 6
_SAMPLES = 60


def held_out_log_densities(
    scan: Scan, scene: Scene, rows: np.ndarray, build: Callable[[Scan], MeasurementModel]
) -> tuple[np.ndarray, np.ndarray]:
    """Log-densities of some strains at their true positions, each by a map without its sweep.

    Parameters
    ----------
    scan, scene : the training pairs and what is modelled
    rows : indices of the pairs of interest; up to 60 from each of up to 6 sweeps are tried
    build : makes the measurement model from a scan with one sweep left out

    Returns
    -------
    tried : (M,) indices of the pairs
    log_densities : (M,) nats
    """
    columns, channels = scene.columns(scan.axes), scene.channels(scan.phalanges)
    sweep = divided(scan.sweep)
    numbers = np.unique(sweep[rows])
    tried, values = [], []
    for number in numbers[_spread(len(numbers), _SWEEPS)]:
        own = rows[sweep[rows] == number]
        model = build(scan.select(sweep != number))
        for row in own[_spread(len(own), _SAMPLES)]:
            tried.append(row)
            values.append(model.log_likelihood(scan.states[row, columns][None], scan.strain[row, channels])[0])
    return np.array(tried, dtype=np.intp), np.array(values)


def held_out_fit(scan: Scan, scene: Scene, build: Callable[[Scan], MeasurementModel]) -> float:
    """Log-density, nats, that all but 5 % of held-out strains on the feature reach at their true positions.

    A strain that the believed place explains worse than this is no more like the scanned material than its worst
    explained samples; evidence is therefore counted from here. Minus infinity where no pair is on the feature.
    """
    on = np.flatnonzero(scene.on_feature(scan.states[:, scene.columns(scan.axes)]))
    _, values = held_out_log_densities(scan, scene, on, build)
    return float(np.quantile(values, QUANTILE)) if len(values) else -np.inf


def _spread(count: int, most: int) -> np.ndarray:
    """Up to ``most`` of ``count`` indices, evenly spread."""
    return np.unique(np.linspace(0, max(count - 1, 0), min(count, most)).astype(int))
