"""Measurements of a sweep: strains by travelled distance, before anything is known of the position."""

from typing import NamedTuple

import numpy as np

from tactile_localizer.core.geometry.motion import MotionModel
from tactile_localizer.core.likelihood.gain import RECENT
from tactile_localizer.core.likelihood.white_noise import SweepNoise, WhiteNoise
from tactile_localizer.core.plausibility import StampUnit, StuckGauges
from tactile_localizer.core.scan.range import ScanRange
from tactile_localizer.core.strain_mean import StrainMean
from tactile_localizer.scene import Scene

UPDATE_PERIOD_NS = 8_000_000
"""Least time between two measurement updates, ns, by their stamps. A hand that moves fast, as between sweeps,
passes an update distance with every strain; an update for each would take longer than they take to come."""
_ROUNDING = 1e-6
"""Fraction by which rounding may shorten a travel. Else, where strains are an update distance apart, the
origin of the arm's frame decides which of them lead to an update."""
_SILENT = 1e9
"""Noise of a channel that does not count, in variances of a visit."""


class Measurement(NamedTuple):
    """What a measurement update takes in.

    Parameters
    ----------
    strain : (C,) mean since the last update, V
    displacement : (d,) from the mean position of the strains of the last update to theirs, m (yaw: rad)
    travel : length of the displacement, m
    pending : (d,) displacement from that mean position to the last strain, m (yaw: rad)
    used : (F,) bool, phalanges that count
    excess : (C, C) V^2, covariance by which the noise of the strain exceeds that of the scan's
    outside : fraction of the recent strains that are outside the range of the scan
    set_down : whether the hand was lifted and set down again since the last update: there was a gap of more
        than :data:`~.gain.RECENT` between two strains
    """

    strain: np.ndarray
    displacement: np.ndarray
    travel: float
    pending: np.ndarray
    used: np.ndarray
    excess: np.ndarray
    outside: float
    set_down: bool


class Measurements:
    """Makes a measurement of the strains of each ``update_distance`` of travel, and of the first one.

    Measurements come not more often than each :data:`UPDATE_PERIOD_NS`; a hand at rest learns nothing new.

    Parameters
    ----------
    scene : names the axes and phalanges
    white_noise : of the scan's channels
    variance : (C,) V^2, of a visit
    scan_range : range of the scan's strains
    still_travel : (C,) m over which each channel of the scan repeats its strain
    update_distance : m of travel between two measurements

    Attributes
    ----------
    update_distance : may be changed at any time
    outside : fraction of the recent strains that are outside the range of the scan
    """

    def __init__(
        self,
        scene: Scene,
        white_noise: WhiteNoise,
        variance: np.ndarray,
        scan_range: ScanRange,
        still_travel: np.ndarray,
        update_distance: float,
    ) -> None:
        self.update_distance = update_distance
        self._layout, self._motion = scene.layout, MotionModel(scene)
        self._channels = self._layout.expand(self._layout.every)
        self._mean, self._noise = StrainMean(self._motion), SweepNoise(white_noise)
        self._gauges, self._range, self._stamp_unit = StuckGauges(still_travel), scan_range, StampUnit()
        self._silent = _SILENT * variance
        self.reset()

    def reset(self) -> None:
        """Begin a sweep."""
        for part in (self._mean, self._noise, self._gauges, self._stamp_unit):
            part.reset()
        self._stamp_ns: int | None = None
        self._set_down = False
        self._updated_ns = self._count = 0
        self.outside = 0.0

    @property
    def stuck(self) -> np.ndarray:
        """Channels (C,) bool that stand still."""
        return self._gauges.stuck

    @property
    def spikes(self) -> np.ndarray:
        """Number (C,) of single values far off that were left out, in all sweeps."""
        return self._noise.spikes

    @property
    def pending(self) -> np.ndarray:
        """Displacement (d,) from the last measurement's position to the last strain's, m (yaw: rad)."""
        return self._mean.pending

    def goes_back(self, stamp_ns: int, position: np.ndarray) -> bool:
        """Whether a stamp, ns, is before the last one, as of a bag that loops.

        Raises
        ------
        MeasurementError
            It is no number of nanoseconds, or the palm travels while the stamps stand still.
        """
        self._stamp_unit.check(stamp_ns, position)
        return self._stamp_ns is not None and stamp_ns < self._stamp_ns

    def observe(
        self, stamp_ns: int, position: np.ndarray, strain: np.ndarray, present: np.ndarray
    ) -> Measurement | None:
        """Take in a strain (C,), V, at a palm position (d,), of the phalanges ``present`` (F,) bool.

        Returns the measurement of the strains since the last one, if one is due.
        """
        self._stamp_ns, is_whole = stamp_ns, present is self._layout.every
        channels = self._channels if is_whole else self._layout.expand(present)
        step = self._mean.step(position)
        kept = self._noise.observe(strain, channels, step)
        self._set_down |= self._noise.is_after_gap and step > RECENT
        self._mean.add(position, kept, present)
        due = not self._count or (
            self._mean.travel >= (1.0 - _ROUNDING) * self.update_distance
            and stamp_ns - self._updated_ns >= UPDATE_PERIOD_NS
        )
        if not due:
            return None
        self._updated_ns = stamp_ns
        mean, displacement = self._mean.take()
        travel = self._motion.travel(displacement)
        self._gauges.observe(strain, channels, travel)
        working, used = channels, present
        if np.count_nonzero(self._gauges.stuck):
            working = channels & ~self._gauges.stuck
            working = working if np.count_nonzero(working) else channels
            used = self._layout.any(working)
        self._count += 1  # at first the mean is over all strains, so that a spike is only one of them
        share = max(min(1.0, travel / RECENT), 1.0 / self._count)
        self.outside += share * (float(self._range.strains_outside(strain, used)) - self.outside)
        excess = self._noise.excess(self.update_distance)
        if np.count_nonzero(excess):
            bounded = np.sqrt(self._silent / np.maximum(excess.diagonal(), self._silent))
            excess = bounded[:, None] * excess * bounded
        if np.count_nonzero(working) < len(working):
            # Channels are whitened together: one that does not count is one that is all noise.
            excess = excess * np.outer(working, working) + np.diag(np.where(working, 0.0, self._silent))
        pending, set_down, self._set_down = self._mean.pending, self._set_down, False
        return Measurement(mean, displacement, travel, pending, used, excess, self.outside, set_down)
