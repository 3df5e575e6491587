"""Localization on a stream of strain vectors with palm positions, with counts of unusable ones."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Sequence

import numpy as np

from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.core.scan.range import ScanRange, describe_misfit
from tactile_localizer.errors import MeasurementError
from tactile_localizer.io.recording import usable
from tactile_localizer.io.scans.recorder import StrainSample
from tactile_localizer.streams.synchronization import Pair

_TIMES_KEPT = 4096
_BEFORE_FIRST_NS = -1
_RANGE_WINDOW = 200
"""Number of measurement updates for the fractions out of range: 0.2 m of travel at the default distance."""
_MIN_UPDATES = 20
"""Number of measurement updates below which nothing is reported as out of range."""


USED = ("updated", "moved", "earlier")
"""Strain vectors that led to a measurement update, to a motion update only, and those that are stamped before
the last reset or seeding of the belief."""


class RangeCheck:
    """Fractions of recent strains out of the range of the scan, and of positions too far from the start.

    Parameters
    ----------
    scan_range : range of the scan
    """

    def __init__(self, scan_range: ScanRange) -> None:
        self._range = scan_range
        self._start: np.ndarray | None = None
        self._outside: deque[tuple[bool, bool]] = deque(maxlen=_RANGE_WINDOW)

    def reset(self) -> None:
        """Discard the updates so far; the next position is the start."""
        self._start = None
        self._outside.clear()

    def add(self, position: np.ndarray, strain: np.ndarray, present: np.ndarray) -> None:
        """Add position (d,), m, strain (C,), V, and usable phalanges (F,) bool of a measurement update."""
        if self._start is None:
            self._start = position
        strain_is_outside = bool(self._range.strains_outside(strain, present))
        self._outside.append((strain_is_outside, bool(self._range.positions_outside(position, self._start))))

    @property
    def fractions(self) -> tuple[float, float]:
        """Fractions of strains and of positions outside; zero during the first updates."""
        if len(self._outside) < _MIN_UPDATES:
            return 0.0, 0.0
        strains, positions = np.mean(self._outside, axis=0).tolist()
        return strains, positions

    @property
    def problem(self) -> str:
        """Description of the misfit in one line; empty if there is none."""
        return describe_misfit(*self.fractions)


class OnlineLocalizer:
    """Passes the usable pairs of strain vectors and palm positions to a localizer.

    Parameters
    ----------
    localizer : localizer to update
    max_gap_s : longest interval between the poses before and after a strain vector, s
    scan_range : range of the scan in the map

    Attributes
    ----------
    latest : last estimate; ``None`` before the first
    palm : (d,) palm position of the last estimate, m (yaw: rad); ``None`` before the first
    range_check : comparison of strains and positions with the scan
    last_error : why the last strain vector was not used; empty if it was
    counts : numbers of strain vectors by what became of them: one of :data:`USED`, or why they were not used
    update_times_ns : durations of the last measurement updates
    """

    def __init__(self, localizer: Localizer, max_gap_s: float, scan_range: ScanRange) -> None:
        self.localizer = localizer
        self.range_check = RangeCheck(scan_range)
        self.palm: np.ndarray | None = None
        self.last_error = ""
        self.counts: Counter[str] = Counter()
        self.update_times_ns: deque[int] = deque(maxlen=_TIMES_KEPT)
        self._max_gap_s = max_gap_s
        self._epoch = 0
        self.reset()

    @property
    def estimates(self) -> int:
        """Number of estimates so far."""
        return self.counts["updated"] + self.counts["moved"]

    def reset(self, since_ns: int = _BEFORE_FIRST_NS) -> None:
        """Reset to a uniform belief; strain vectors stamped up to ``since_ns`` are ignored."""
        self.localizer.reset()
        self._restart(since_ns)

    def seed(self, mean: np.ndarray, std: np.ndarray, since_ns: int = _BEFORE_FIRST_NS) -> None:
        """Reset to a Gaussian with ``mean`` (d,) and standard deviations ``std`` (d,), m (yaw: rad).

        Strain vectors stamped up to ``since_ns`` are ignored.
        """
        self.localizer.seed(mean, std)
        self._restart(since_ns)

    def _restart(self, since_ns: int) -> None:
        self.latest: Estimate | None = None
        self._since_ns = since_ns
        self.range_check.reset()

    def take(self, pairs: Sequence[Pair[StrainSample]], epoch: int) -> list[Estimate]:
        """Update with pairs of strain vectors and positions; returns their estimates.

        ``epoch`` is the number of backward jumps of the stamps so far.
        """
        if epoch != self._epoch:
            self._epoch, self._since_ns = epoch, _BEFORE_FIRST_NS
            self.range_check.reset()
        return [estimate for pair in pairs if (estimate := self._localize(pair)) is not None]

    def _localize(self, pair: Pair[StrainSample]) -> Estimate | None:
        counts = self.counts
        if pair.stamp_ns <= self._since_ns:
            counts["earlier"] += 1
            return None
        strain, status = pair.measurement
        present = usable(status)
        if not present.all():
            names = self.localizer.scene.phalanx_names
            counts.update(f"without {phalanx}" for phalanx, ok in zip(names, present, strict=True) if not ok)
        if pair.position is None:
            counts["without a pose"] += 1
            self.last_error = f"no palm pose within {self._max_gap_s:g} s of the strain"
        elif not present.any():
            counts["without a phalanx with status OK"] += 1
            self.last_error = "no phalanx with status OK"
        else:
            try:
                self._update(pair.stamp_ns, pair.position, strain, present)
            except MeasurementError as error:
                counts["that are not finite"] += 1
                self.last_error = str(error)
            else:
                self.last_error = ""
                return self.latest
        return None

    def _update(self, stamp_ns: int, position: np.ndarray, strain: np.ndarray, present: np.ndarray) -> None:
        start_ns = time.perf_counter_ns()
        self.latest = self.localizer.update(stamp_ns, position, strain, present)
        self.palm = position
        if self.latest.updated:
            self.counts["updated"] += 1
            self.range_check.add(position, strain, present)
            self.update_times_ns.append(time.perf_counter_ns() - start_ns)
        else:
            self.counts["moved"] += 1
