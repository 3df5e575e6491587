"""Share of recent strains and positions that the scans cannot explain."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from tactile_localizer.core.scan.range import ScanRange, describe_misfit

_KEPT = 200
"""Measurement updates that the shares are of, 0.2 m of travel at the default update distance."""
_FEWEST = 20
"""Measurement updates below which nothing is reported."""


class ScanFit:
    """Counts strains outside the range of every scan, and positions too far from where the belief began.

    Parameters
    ----------
    ranges : of the scans
    """

    def __init__(self, ranges: Sequence[ScanRange]) -> None:
        self._ranges = ranges
        self._start: np.ndarray | None = None
        self._outside: deque[tuple[bool, bool]] = deque(maxlen=_KEPT)

    def begin(self) -> None:
        """The next position is where the belief begins."""
        self._start = None
        self._outside.clear()

    def add(self, position: np.ndarray, strain: np.ndarray, present: np.ndarray) -> None:
        """Take in what one measurement update was made from: (d,) m, (C,) V and (F,) bool."""
        if self._start is None:
            self._start = position
        strains = [bool(one.strains_outside(strain, present)) for one in self._ranges]
        positions = [bool(one.positions_outside(position, self._start)) for one in self._ranges]
        self._outside.append((all(strains), all(positions)))

    @property
    def shares(self) -> tuple[float, float]:
        """Share of strains and of positions that are outside; zero while there are few."""
        if len(self._outside) < _FEWEST or not self._ranges:
            return 0.0, 0.0
        strains, positions = np.mean(self._outside, axis=0).tolist()
        return strains, positions

    @property
    def trouble(self) -> str:
        """What does not fit the scans, in one line; empty where it does."""
        return describe_misfit(*self.shares)
