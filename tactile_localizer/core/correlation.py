"""How much a strain says that the strains before it did not."""

from __future__ import annotations

import math

import numpy as np

from tactile_localizer.scene import GAUGES

_LARGEST_CHANGE = 5.0
"""Kernel widths; a gauge that jumps farther says no more."""


class Correlation:
    """Consecutive strains share what makes them differ from the scan: grip, load, how the material lies.

    They grow independent with the travel between them, and with the change of the strain itself: where
    nothing changes, as over featureless material, nothing new is said, and a feature's edge says much in
    little travel. A strain's likelihood counts for the share

    .. math:: \\min(1, \\sqrt{(\\Delta s / l)^2 + (\\Delta z / c)^2})

    of an independent measurement, with l the ``length``, c the ``change`` and Delta z the root mean square
    over the channels of the change since the last weighed strain, in kernel widths.

    Parameters
    ----------
    length : m of travel that make one independent measurement
    change : root mean square change of the strain, in kernel widths, that makes one; ``None``: none does
    strain_std : (8F,) kernel widths in strain, V
    """

    def __init__(self, length: float, change: float | None, strain_std: np.ndarray) -> None:
        self._length = length
        self._change = change
        self._per_width = 1.0 / np.asarray(strain_std, dtype=np.float64)

    def weight(self, travel: float, change: np.ndarray, felt: np.ndarray) -> float:
        """Share of an independent measurement, in (0, 1].

        Parameters
        ----------
        travel : m since the last weighed strain
        change : (8F,) V since then
        felt : (F,) bool, phalanges that were felt at both times
        """
        by_travel = travel / self._length
        if self._change is None or not felt.any():
            return min(1.0, by_travel)
        widths = np.minimum(np.abs(change * self._per_width), _LARGEST_CHANGE)[np.repeat(felt, GAUGES)]
        return min(1.0, math.hypot(by_travel, math.sqrt(widths @ widths / len(widths)) / self._change))
