"""Mean of the strains since the last measurement update."""

import numpy as np

from tactile_localizer.core.geometry.motion import MotionModel
from tactile_localizer.core.scan.tracks import PITCH

_LONGEST = 1.5 * PITCH
"""m over which strains are averaged: as far as the points of a track are apart, and a step more."""


class StrainMean:
    """Mean of the strains since the last measurement update, at their mean position.

    The map is made of means over short stretches too, so that every strain counts once, in the scan as in the
    sweep at hand. Over more than :data:`_LONGEST` a mean would blur what is felt: then, and where the set of
    present phalanges changes, it begins anew.

    Parameters
    ----------
    motion : motion model of the scene

    Attributes
    ----------
    travel : distance of the last strain from that of the last update, m: a pose that trembles does not travel
    """

    def __init__(self, motion: MotionModel) -> None:
        self._motion = motion
        self.reset()

    def reset(self) -> None:
        """Begin a sweep."""
        self._begun, self._count = False, 0
        self._last = self._updated_at = self._mean_at = self._first = np.zeros(0)
        self._sum, self._moved, self._present = np.zeros(0), np.zeros(0), np.zeros(0, dtype=bool)
        self.travel = 0.0

    def step(self, position: np.ndarray) -> float:
        """Travel to a palm position (d,) from that of the strain before it, m."""
        return self._motion.travel(self._motion.displacement(self._last, position)) if self._begun else 0.0

    def add(self, position: np.ndarray, strain: np.ndarray, present: np.ndarray) -> None:
        """Add a strain (C,) at a palm position (d,)."""
        if not self._begun:
            self._begun, self._last, self._updated_at, self._mean_at = True, position, position, position
        far = self._count and self._motion.travel(self._motion.displacement(self._first, position)) > _LONGEST
        if not self._count or far or self._has_other(present):
            self._count, self._present, self._first = 0, present, position
            self._sum, self._moved = np.zeros_like(strain), np.zeros_like(position)
        self._last = position
        self._count += 1
        self._sum = self._sum + strain
        moved = self._motion.displacement(self._updated_at, position)
        self.travel = self._motion.travel(moved)
        self._moved = self._moved + moved

    def _has_other(self, present: np.ndarray) -> bool:
        """Whether other phalanges are ``present`` (F,) bool than in the strains so far."""
        return present is not self._present and bool(np.count_nonzero(present != self._present))

    @property
    def pending(self) -> np.ndarray:
        """Displacement (d,) from the mean position of the last update to the last strain, m (yaw: rad)."""
        return self._motion.displacement(self._mean_at, self._last)

    def take(self) -> tuple[np.ndarray, np.ndarray]:
        """The mean strain (C,), and the displacement (d,) to its mean position from that of the last update.

        Then the mean begins anew.
        """
        mean_at = self._motion.wrapped(self._updated_at + self._moved / self._count)
        displacement = self._motion.displacement(self._mean_at, mean_at)
        self._mean_at, self._updated_at = mean_at, self._last
        strain, self._count = self._sum / self._count, 0
        return strain, displacement
