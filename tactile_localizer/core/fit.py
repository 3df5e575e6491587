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


def held_out_fit(scan: Scan, scene: Scene, build: Callable[[Scan], MeasurementModel]) -> float:
    """Log-density, nats, that all but 5 % of held-out strains on the feature reach at their true positions.

    A strain that the believed place explains worse than this is no more like the scanned material than its worst
    explained samples; evidence is therefore counted from here.

    Parameters
    ----------
    scan, scene : the training pairs and what is modelled; without a known feature all pairs count
    build : makes the measurement model from a scan with one sweep left out
    """
    columns, channels = scene.columns(scan.axes), scene.channels(scan.phalanges)
    sweep = divided(scan.sweep)
    on = np.flatnonzero(scene.on_feature(scan.states[:, columns]))
    numbers = np.unique(sweep[on])
    values = []
    for number in numbers[np.unique(np.linspace(0, len(numbers) - 1, _SWEEPS).astype(int))]:
        own = on[sweep[on] == number]
        model = build(scan.select(sweep != number))
        for row in own[np.unique(np.linspace(0, len(own) - 1, _SAMPLES).astype(int))]:
            state = scan.states[row, columns][None]
            values.append(model.log_likelihood(state, scan.strain[row, channels])[0])
    return float(np.quantile(values, QUANTILE)) if values else -np.inf
