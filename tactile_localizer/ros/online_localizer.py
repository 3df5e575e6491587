"""Localization on a stream of strain vectors with palm positions, with counts of unusable ones."""

import time
from collections import Counter, deque
from collections.abc import Sequence

import numpy as np

from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.core.scan.range import ScanRange
from tactile_localizer.errors import MeasurementError
from tactile_localizer.io.recording import usable
from tactile_localizer.io.scans.recorder import StrainSample
from tactile_localizer.streams.session import Pair

_TIMES_KEPT = 4096
_BEFORE_FIRST_NS = -1

USED = ("updated", "moved", "earlier")
"""Strain vectors that led to a measurement update, to a motion update only, and those that are stamped before
the last reset or seeding of the belief."""


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
    last_error : why the last strain vector was not used; empty if it was
    counts : numbers of strain vectors by what became of them: one of :data:`USED`, or why they were not used
    update_times_ns : durations of the last measurement updates
    """

    def __init__(self, localizer: Localizer, max_gap_s: float, scan_range: ScanRange) -> None:
        self.localizer = localizer
        self._range = scan_range
        self.palm: np.ndarray | None = None
        self.last_error = ""
        self.counts: Counter[str] = Counter()
        self.update_times_ns: deque[int] = deque(maxlen=_TIMES_KEPT)
        self._max_gap_s = max_gap_s
        self._run = 0
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
        self._start: np.ndarray | None = None

    @property
    def out_of_range(self) -> tuple[float, float]:
        """Fractions of the recent strains and positions that are out of the range of the scan.

        A position is if it is farther from that of the first estimate than the scene is long.
        """
        if self.palm is None or self._start is None:
            return 0.0, 0.0
        return self.localizer.out_of_range, float(self._range.positions_outside(self.palm, self._start))

    def take(self, pairs: Sequence[Pair[StrainSample]]) -> list[Estimate]:
        """Update with pairs of strain vectors and positions; returns their estimates."""
        return [estimate for pair in pairs if (estimate := self._localize(pair)) is not None]

    def _localize(self, pair: Pair[StrainSample]) -> Estimate | None:
        counts = self.counts
        if pair.run != self._run:
            self._run, self._since_ns, self._start = pair.run, _BEFORE_FIRST_NS, None
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
        self._start = position if self._start is None else self._start
        if self.latest.updated:
            self.counts["updated"] += 1
            self.update_times_ns.append(time.perf_counter_ns() - start_ns)
        else:
            self.counts["moved"] += 1
