"""Plausibility of what a localizer receives: the unit of the stamps, and gauges that are stuck."""

import numpy as np

from tactile_localizer.core.geometry.motion import MotionModel
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import MeasurementError
from tactile_localizer.quantity import is_number
from tactile_localizer.scene import Scene

_MIN_PERIOD_NS = 100_000
"""Shortest plausible period of a tactile sensor, ns (judgement); stamps in µs advance by less."""
_MAX_TRAVEL_M = 0.01
"""m of travel at a shorter period, over several samples, that is refused."""
_MIN_SAMPLES = 3
_STUCK = 0.002
"""m of travel over which a gauge that repeats its strain to the last bit, while another changes, is stuck: a
gauge that works has noise. Longer where it did so in the scan, as a coarse one does."""


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


class StuckGauges:
    """Which gauges repeat their strain to the last bit, while another one changes.

    Parameters
    ----------
    longest : (C,) m of travel over which each did so in the scan; infinite for one that is never judged

    Attributes
    ----------
    stuck : (C,) bool
    """

    def __init__(self, longest: np.ndarray) -> None:
        self._limit = np.maximum(_STUCK, 2.0 * longest)
        self.reset()

    def reset(self) -> None:
        """Take every gauge as working."""
        self._last: np.ndarray | None = None
        self._counting = False
        self._unchanged = np.zeros(len(self._limit))
        self.stuck = self._unchanged >= self._limit

    def observe(self, strain: np.ndarray, present: np.ndarray, travel: float) -> None:
        """Take in a ``strain`` (C,) after ``travel`` metres; ``present`` (C,) bool."""
        if self._last is not None:
            same = present & (strain == self._last)
            count = np.count_nonzero(same)
            if count or self._counting:
                more = travel * (count < np.count_nonzero(present))  # another one changes
                self._unchanged = np.where(same, self._unchanged + more, 0.0)
                self.stuck = self._unchanged >= self._limit
            self._counting = bool(count)
        self._last = strain


def still_travel(scan: Scan, scene: Scene) -> np.ndarray:
    """Longest travel (C,), m, over which a channel of a scan repeats its strain; infinite: all along."""
    motion, positions, strain = MotionModel(scene), scan.positions_on(scene), scan.strain_on(scene)
    longest = np.zeros(strain.shape[1])
    for own in scan.rows_by_sweep:
        path = positions[own]
        along = motion.travels(motion.wrapped(np.diff(path, axis=0, prepend=path[:1]))).cumsum()
        ends = np.where(np.diff(strain[own], axis=0) != 0.0, along[:-1, None], 0.0)
        ends = np.maximum.accumulate(np.vstack([np.zeros_like(longest), ends]))
        longest = np.maximum(longest, (along[:, None] - ends).max(axis=0))
    return np.where((strain == strain[:1]).all(axis=0), np.inf, longest)
