"""Detection of stamps in a wrong unit: the palm travels while they stand still."""

from __future__ import annotations

import numpy as np

from tactile_localizer.core.geometry.pose_buffer import NANOSECONDS
from tactile_localizer.errors import MeasurementError
from tactile_localizer.quantity import is_number

_MIN_STEP_NS = NANOSECONDS // 1000
_MAX_TRAVEL_M = 0.01
"""Travel within ``_MIN_STEP_NS``, over several samples, that no hand makes: 10 m/s (judgement)."""
_MIN_SAMPLES = 3


class StampUnit:
    """Check of successive stamps and positions; a single jump of the position is allowed."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Begin anew."""
        self._samples = 0
        self._begin_ns, self._begin = 0, np.zeros(0)

    def check(self, stamp_ns: int, position: np.ndarray) -> None:
        """Add a sample with position (d,), m (yaw: rad).

        Raises
        ------
        MeasurementError
            The stamp is not a number, or stands still while the palm travels.
        """
        if not is_number(stamp_ns):
            raise MeasurementError(f"stamp_ns: expected a whole number of ns, got {stamp_ns!r}")
        advance = stamp_ns - self._begin_ns
        if not self._samples or not 0 <= advance < _MIN_STEP_NS:
            self._samples, self._begin_ns, self._begin = 1, stamp_ns, position
            return
        self._samples += 1
        travel = float(np.linalg.norm(position - self._begin))
        if travel > _MAX_TRAVEL_M and self._samples > _MIN_SAMPLES:
            raise MeasurementError(
                f"stamp_ns: expected ns, the palm travelled {travel * 1e3:.0f} mm in {advance:g} ns over "
                f"{self._samples} samples (stamps in s? * 1e9)"
            )
