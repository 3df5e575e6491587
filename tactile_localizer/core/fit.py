"""How well the map explains sweeps that are not in it: the yardstick for material that was never scanned."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tactile_localizer.core.likelihood.base import MeasurementModel
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.spacing import divided
from tactile_localizer.scene import Scene

QUANTILE = 0.05
_SWEEPS = 6
_SAMPLES = 60


def held_out_log_densities(
    scan: Scan, scene: Scene, rows: np.ndarray, build: Callable[[Scan], MeasurementModel]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Log-densities of some strains at their true positions, each by a map without its sweep.

    Parameters
    ----------
    scan, scene : the training pairs and what is modelled
    rows : indices of the pairs of interest; up to 60 from each of up to 6 sweeps are tried
    build : makes the measurement model from a scan with one sweep left out

    Returns
    -------
    tried : (M,) indices of the pairs
    together : (M,) nats, of all phalanges
    alone : (M, F) nats, of each phalanx by itself
    """
    columns, channels = scene.columns(scan.axes), scene.channels(scan.phalanges, scan.channels)
    sweep = divided(scan.sweep)
    numbers = np.unique(sweep[rows])
    single = np.eye(len(scene.phalanges), dtype=bool)
    tried, together, alone = [], [], []
    for number in numbers[_spread(len(numbers), _SWEEPS)]:
        own = rows[sweep[rows] == number]
        model = build(scan.select(sweep != number))
        for row in own[_spread(len(own), _SAMPLES)]:
            state, strain = scan.states[row, columns][None], scan.strain[row, channels]
            tried.append(row)
            together.append(model.log_likelihood(state, strain)[0])
            if len(single) > 1:
                alone.append([model.log_likelihood(state, strain, present)[0] for present in single])
            else:
                alone.append([together[-1]])
    return (
        np.array(tried, dtype=np.intp),
        np.array(together),
        np.array(alone).reshape(len(tried), len(single)),
    )


@dataclass(frozen=True)
class HeldOutFit:
    """Log-densities, nats, that all but 5 % of held-out strains on the feature reach at their true positions.

    A strain that the believed place explains worse is no more like the scanned material than its worst
    explained samples; evidence is therefore counted from here. ``together`` of all phalanges, ``alone`` (F,)
    of each by itself.
    """

    together: float
    alone: np.ndarray

    @classmethod
    def unknown(cls, phalanges: int) -> HeldOutFit:
        """No lower limit: nothing could be held out."""
        return cls(-np.inf, np.full(phalanges, -np.inf))

    def of(self, present: np.ndarray) -> float:
        """The limit for the phalanges that are ``present`` (F,); some of several have their share of it."""
        if present.all():
            return self.together
        if not np.isfinite(self.together):
            return -np.inf
        return float(self.alone[present].mean() if present.sum() == 1 else self.together * present.mean())


def held_out_fit(scan: Scan, scene: Scene, build: Callable[[Scan], MeasurementModel]) -> HeldOutFit:
    """How well sweeps are explained by the others, on the feature; without one known, everywhere."""
    on = np.flatnonzero(scene.on_feature(scan.states[:, scene.columns(scan.axes)]))
    _, together, alone = held_out_log_densities(scan, scene, on, build)
    if len(together) == 0:
        return HeldOutFit.unknown(len(scene.phalanges))
    return HeldOutFit(float(np.quantile(together, QUANTILE)), np.quantile(alone, QUANTILE, axis=0))


def _spread(count: int, most: int) -> np.ndarray:
    """Up to ``most`` of ``count`` indices, evenly spread."""
    return np.unique(np.linspace(0, max(count - 1, 0), min(count, most)).astype(int))
