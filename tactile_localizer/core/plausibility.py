"""Plausibility of what a localizer receives: the unit of the stamps, and load cells that are stuck."""

from __future__ import annotations

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.geometry.runs import NANOSECONDS
from tactile_localizer.errors import MeasurementError
from tactile_localizer.quantity import is_number

_MIN_PERIOD_NS = NANOSECONDS // 10_000
"""Shortest plausible period of a tactile sensor, ns (judgement); stamps in µs advance by less."""
_MAX_TRAVEL_M = 0.01
"""m of travel at a shorter period, over several samples, that is refused."""
_MIN_SAMPLES = 3
_STUCK = 0.002
"""m of travel over which a phalanx that repeats its strain to the last bit, while another changes, is stuck:
a load cell that works has noise."""


class StampUnit:
    """Detects stamps in a wrong unit: the palm travels while they hardly advance."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Begin anew."""
        self._samples = 0
        self._begin_ns, self._last_ns, self._begin = 0, 0, np.zeros(0)

    def check(self, stamp_ns: int, position: np.ndarray) -> None:
        """Add a sample with position (d,), m (yaw: rad).

        Raises
        ------
        MeasurementError
            The stamp is not a number, or hardly advances while the palm travels.
        """
        if not is_number(stamp_ns):
            raise MeasurementError(f"stamp_ns: expected a whole number of ns, got {stamp_ns!r}")
        step, self._last_ns = stamp_ns - self._last_ns, stamp_ns
        if not self._samples or not 0 <= step < _MIN_PERIOD_NS:
            self._samples, self._begin_ns, self._begin = 1, stamp_ns, position
            return
        self._samples += 1
        travel = float(np.linalg.norm(position - self._begin))
        if travel > _MAX_TRAVEL_M and self._samples > _MIN_SAMPLES:
            raise MeasurementError(
                f"stamp_ns: expected ns, the palm travelled {travel * 1e3:.0f} mm in "
                f"{stamp_ns - self._begin_ns:g} ns over {self._samples} samples "
                "(stamps in s? * 1e9; in us? * 1000)"
            )


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
