"""Phalanges that are stuck: a load cell that repeats itself to the last bit."""

from __future__ import annotations

import numpy as np

from tactile_localizer.channels import ChannelLayout

_STUCK = 0.002
"""m of travel over which a phalanx that repeats its strain to the last bit, while another changes, is stuck:
a load cell that works has noise."""


class PhalanxConsistency:
    """Which phalanges are not stuck. A phalanx that contradicts the map otherwise speaks against the map.

    Parameters
    ----------
    layout : channels of each phalanx

    Attributes
    ----------
    consistent : (F,) bool; replaced, never changed in place
    """

    def __init__(self, layout: ChannelLayout) -> None:
        self._layout = layout
        self.reset()

    def reset(self) -> None:
        """Take every phalanx as consistent."""
        self.consistent = np.ones(self._layout.phalanges, dtype=bool)
        self._last: np.ndarray | None = None
        self._unchanged = np.zeros(self._layout.phalanges)

    def observe(self, strain: np.ndarray, present: np.ndarray, travel: float) -> None:
        """Note which phalanges repeat their ``strain`` (C,) over ``travel`` metres; ``present`` (F,) bool."""
        if self._last is not None:
            same = present & self._layout.all(strain == self._last)
            others_change = (present & ~same).any()
            self._unchanged = np.where(same, self._unchanged + travel * others_change, 0.0)
        self._last = strain.copy()
        self.consistent = self._unchanged < _STUCK
