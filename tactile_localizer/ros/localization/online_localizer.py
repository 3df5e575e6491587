"""Pairs strains with palm poses as they arrive, feeds the localizer, and counts what cannot be used."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactile_localizer.core.geometry.pose_buffer import NANOSECONDS
from tactile_localizer.core.geometry.synchronization import Pair, Pairing
from tactile_localizer.core.identification import FeatureLocalizer
from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.core.scan.range import ScanRange
from tactile_localizer.errors import MeasurementError
from tactile_localizer.io.recording import usable
from tactile_localizer.ros.localization.scan_fit import ScanFit

_TIMES_KEPT = 4096
_BEFORE_ALL_NS = -1

Felt = tuple[np.ndarray, np.ndarray]
"""Strain voltages (C,), V, and status bits (F,)."""


@dataclass
class Counts:
    """Strain vectors since the start, by how they were used.

    Parameters
    ----------
    absent : vectors in which a phalanx was missing, saturated or faulty, by phalanx
    updated : led to a measurement update
    moved : only moved the belief along
    earlier : stamped before the belief was last reset or seeded
    gaps : had no pose near enough in time
    unusable : had no phalanx with status OK
    refused : were not finite
    """

    absent: dict[str, int]
    updated: int = 0
    moved: int = 0
    earlier: int = 0
    gaps: int = 0
    unusable: int = 0
    refused: int = 0


class OnlineLocalizer:
    """Feeds a localizer in the order of the stamps, and knows how old its last estimate is.

    Parameters
    ----------
    localizer : that is fed
    max_gap_s : longest time between the two poses around a strain vector, s
    patience_s : time, by stamps, that a strain vector waits for its pose, s
    ranges : of the scans that are localized on

    Attributes
    ----------
    latest : the last estimate; ``None`` before the first
    palm : (d,) palm position that it was made with, m (yaw: rad); ``None`` before the first
    fit : whether strains and positions are in the range of the scans
    trouble : why the last strain vector was not used; empty when it was
    counts : strain vectors by how they were used
    leaps : times that strain stamps went on by more than ``patience_s``: silence, or a clock that was set
    update_times_ns : duration of the last measurement updates
    """

    def __init__(
        self,
        localizer: Localizer | FeatureLocalizer,
        max_gap_s: float,
        patience_s: float,
        ranges: Sequence[ScanRange] = (),
    ) -> None:
        self.localizer = localizer
        self.fit = ScanFit(ranges)
        self.latest: Estimate | None = None
        self.palm: np.ndarray | None = None
        self.trouble = ""
        self.leaps = 0
        self.counts = Counts(dict.fromkeys(localizer.scene.phalanx_names, 0))
        self.update_times_ns: deque[int] = deque(maxlen=_TIMES_KEPT)
        self._max_gap_s, self._patience_s = max_gap_s, patience_s
        self.interrupt()

    def interrupt(self) -> None:
        """Forget the poses, and the strains that wait for one: the next do not continue the last."""
        scene = self.localizer.scene
        self.pairing: Pairing[Felt] = Pairing(
            scene.axes, max_gap_s=self._max_gap_s, patience_s=self._patience_s
        )
        self._newest_ns: dict[str, int] = {}
        self._resets = 0
        self._since_ns = _BEFORE_ALL_NS

    def reset(self, since_ns: int = _BEFORE_ALL_NS) -> None:
        """Return to a uniform belief; strains up to ``since_ns`` are ignored, even if they arrive later."""
        self.localizer.reset()
        self._begin(since_ns)

    def seed(self, mean: np.ndarray, std: np.ndarray, since_ns: int = _BEFORE_ALL_NS) -> None:
        """Start from a Gaussian about ``mean`` (d,) with standard deviations ``std`` (d,), m (yaw: rad).

        Strains up to ``since_ns`` are ignored, as by :meth:`reset`.
        """
        self.localizer.seed(mean, std)
        self._begin(since_ns)

    def _begin(self, since_ns: int) -> None:
        self.latest, self._since_ns = None, since_ns
        self.fit.begin()

    @property
    def age_s(self) -> float:
        """How far, by stamps, the inputs have gone beyond the last estimate, s; 0 before the first."""
        if self.latest is None or not self._newest_ns:
            return 0.0
        return (max(self._newest_ns.values()) - self.latest.stamp_ns) / NANOSECONDS

    @property
    def behind(self) -> str:
        """Which input's stamps are behind the other's: ``strain`` or ``palm_pose``."""
        return min(("strain", "palm_pose"), key=lambda topic: self._newest_ns.get(topic, -1))

    def add_strain(self, stamp_ns: int, strain: np.ndarray, status: np.ndarray) -> list[Estimate]:
        """Take in a strain vector (C,), V, and status bits (F,); returns the estimates that it completes."""
        newest_ns = self.pairing.newest_ns
        self.leaps += newest_ns is not None and stamp_ns - newest_ns > self._patience_s * NANOSECONDS
        return self._take("strain", stamp_ns, self.pairing.add_strain(stamp_ns, (strain, status)))

    def add_pose(self, stamp_ns: int, position: np.ndarray) -> list[Estimate]:
        """Take in a palm position (d,), m (yaw: rad); returns the estimates that it completes.

        Raises
        ------
        MeasurementError
            The position is not finite or not of the scene's axes.
        """
        return self._take("palm_pose", stamp_ns, self.pairing.add_pose(stamp_ns, position))

    def _take(self, topic: str, stamp_ns: int, pairs: list[Pair[Felt]]) -> list[Estimate]:
        if self.pairing.resets != self._resets:
            self._resets = self.pairing.resets
            self._newest_ns.clear()
            self._since_ns = _BEFORE_ALL_NS
            self.fit.begin()
        self._newest_ns[topic] = max(self._newest_ns.get(topic, stamp_ns), stamp_ns)
        return [estimate for pair in pairs if (estimate := self._localize(pair)) is not None]

    def _localize(self, pair: Pair[Felt]) -> Estimate | None:
        counts = self.counts
        if pair.stamp_ns <= self._since_ns:
            counts.earlier += 1
            return None
        strain, status = pair.felt
        present = usable(status)
        for phalanx, ok in zip(counts.absent, present, strict=True):
            counts.absent[phalanx] += not ok
        if pair.position is None:
            counts.gaps += 1
            self.trouble = f"no palm pose within {self._max_gap_s:g} s of the strain"
        elif not present.any():
            counts.unusable += 1
            self.trouble = "no phalanx is OK"
        else:
            try:
                self._update(pair.stamp_ns, pair.position, strain, present)
            except MeasurementError as error:
                counts.refused += 1
                self.trouble = str(error)
            else:
                self.trouble = ""
                return self.latest
        return None

    def _update(self, stamp_ns: int, position: np.ndarray, strain: np.ndarray, present: np.ndarray) -> None:
        begun_ns = time.perf_counter_ns()
        self.latest = self.localizer.update(stamp_ns, position, strain, present)
        self.palm = position
        if self.latest.updated:
            self.counts.updated += 1
            self.fit.add(position, strain, present)
            self.update_times_ns.append(time.perf_counter_ns() - begun_ns)
        else:
            self.counts.moved += 1
