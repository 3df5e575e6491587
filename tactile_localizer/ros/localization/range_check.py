"""Check of recent strains and positions against the ranges of the training scans."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from tactile_localizer.core.scan.range import ScanRange, describe_misfit

_WINDOW = 200
"""Number of measurement updates for the fractions: 0.2 m of travel at the default update distance."""
_MIN_UPDATES = 20
"""Number of measurement updates below which nothing is reported."""


class RangeCheck:
    """Fractions of strains outside the range of every scan, and of positions too far from the start.

    Parameters
    ----------
    ranges : ranges of the scans
    """

    def __init__(self, ranges: Sequence[ScanRange]) -> None:
        self._ranges = ranges
        self._start: np.ndarray | None = None
        self._outside: deque[tuple[bool, bool]] = deque(maxlen=_WINDOW)

    def reset(self) -> None:
        """Discard the updates so far; the next position is the start."""
        self._start = None
        self._outside.clear()

    def add(self, position: np.ndarray, strain: np.ndarray, present: np.ndarray) -> None:
        """Add position (d,), m, strain (C,), V, and usable phalanges (F,) bool of a measurement update."""
        if self._start is None:
            self._start = position
        strains = [bool(one.strains_outside(strain, present)) for one in self._ranges]
        positions = [bool(one.positions_outside(position, self._start)) for one in self._ranges]
        self._outside.append((all(strains), all(positions)))

    @property
    def fractions(self) -> tuple[float, float]:
        """Fractions of strains and of positions outside; zero during the first updates."""
        if len(self._outside) < _MIN_UPDATES or not self._ranges:
            return 0.0, 0.0
        strains, positions = np.mean(self._outside, axis=0).tolist()
        return strains, positions

    @property
    def problem(self) -> str:
        """Description of the misfit in one line; empty if there is none."""
        return describe_misfit(*self.fractions)
