"""How much a strain says that the strains before it did not."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from tactile_localizer.channels import ChannelLayout

_SPAN = 0.001
"""m of travel over which the change is taken. Noise changes at once: so it counts the same, however often
strains are weighed."""
_LARGEST_CHANGE = 5.0
"""Kernel widths; a gauge that jumps farther says no more."""


class Correlation:
    """Consecutive strains share what makes them differ from the scan: grip, load, how the material lies.

    They grow independent with the travel between them, and with the change of the strain itself: where
    nothing changes, as over featureless material, nothing new is said, and a feature's edge says much in
    little travel. Over a way Delta s the strains make a share

    .. math:: \\min(1, \\sqrt{(\\Delta s / l)^2 + (\\Delta z / c)^2})

    of an independent measurement, with l the ``length``, c the ``change`` and Delta z the root mean square
    over the channels of their change, in kernel widths. The way reaches back a millimetre, or to the last
    strain, if that was longer ago; a strain has its part of it by the travel since the last one. One that
    is a length away from the last counts in full, as all do in the paper.

    Parameters
    ----------
    length : m of travel that make one independent measurement
    change : root mean square change of the strain, in kernel widths, that makes one; ``None``: none does
    strain_std : (C,) kernel widths in strain, V
    layout : the channels by phalanx; ``None``: the default channels each
    """

    def __init__(
        self,
        length: float,
        change: float | None,
        strain_std: np.ndarray,
        layout: ChannelLayout | None = None,
    ) -> None:
        self._length = length
        self._change = change
        self._layout = layout or ChannelLayout.default(len(strain_std))
        self._per_width = 1.0 / np.asarray(strain_std, dtype=np.float64)
        self.reset()

    def reset(self) -> None:
        """Forget the strains."""
        self._travelled = 0.0
        self._past: deque[tuple[float, np.ndarray, np.ndarray]] = deque()

    def share(self, strain: np.ndarray, felt: np.ndarray, travel: float) -> float:
        """Take in a strain; returns the share of an independent measurement that it makes, in (0, 1].

        Parameters
        ----------
        strain : (C,) V
        felt : (F,) bool, the phalanges that were felt
        travel : m since the last strain
        """
        self._travelled += travel
        past = self._past
        while len(past) > 1 and self._travelled - past[1][0] > 0.999 * _SPAN:
            past.popleft()
        way, change = travel, 0.0
        if past:
            way = max(self._travelled - past[0][0], travel)
            change = self._widths(strain - past[0][1], felt & past[0][2])
        past.append((self._travelled, strain.copy(), felt))
        if travel >= self._length:
            return 1.0
        by_change = 0.0 if self._change is None else change / self._change
        return min(1.0, math.hypot(way / self._length, by_change)) * travel / way

    def _widths(self, change: np.ndarray, felt: np.ndarray) -> float:
        """Root mean square of a change (C,), V, of phalanges ``felt`` (F,) both times, in kernel widths."""
        if not felt.any():
            return 0.0
        widths = np.minimum(np.abs(change * self._per_width), _LARGEST_CHANGE)[self._layout.expand(felt)]
        return math.sqrt(widths @ widths / len(widths))
