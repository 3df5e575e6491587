"""Motion model: the displacement of the arm plus noise that grows with the travel (paper, Eq. 1)."""

import math

import numpy as np

from tactile_localizer.core.geometry.angles import wrap_angle
from tactile_localizer.scene import Scene

YAW_LEVER = 0.06
"""m of travel per radian of yaw: about the distance of a fingertip from the middle of the palm."""


def levers(scene: Scene) -> np.ndarray:
    """Metres of travel per unit of each axis, (d,): 1, but :data:`YAW_LEVER` for yaw."""
    return np.array([YAW_LEVER if axis.name == "yaw" else 1.0 for axis in scene.axes])


class MotionModel:
    """x_t = x_{t-1} + displacement + noise, with a variance proportional to the distance travelled.

    A variance per metre, not per step, makes the belief independent of the sample rate and leaves a
    hand at rest where it is.

    Parameters
    ----------
    scene : names the axes, their motion noise, and which of them wrap
    """

    def __init__(self, scene: Scene) -> None:
        self._wraps = scene.wraps
        self._turns = bool(self._wraps.any())
        self._variance_per_metre = scene.motion_std**2
        self._levers, self._lever_rows = levers(scene).tolist(), levers(scene)[:, None]

    def displacement(self, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """Displacement (..., d) from ``before`` (d,) or (..., d) to ``after``; yaw by the shortest arc."""
        return self.wrapped(after - before)

    def wrapped(self, values: np.ndarray) -> np.ndarray:
        """``values`` (..., d) with those of full-turn axes in [-pi, pi), in place."""
        if self._turns:
            values[..., self._wraps] = wrap_angle(values[..., self._wraps])
        return values

    def travel(self, displacement: np.ndarray) -> float:
        """Length of a displacement (d,), m; yaw counts by :data:`YAW_LEVER`."""
        # The hot path: for a few numbers a loop is several times faster than arrays.
        squared = 0.0
        for lever, along in zip(self._levers, displacement.tolist(), strict=True):
            squared += (lever * along) * (lever * along)
        return math.sqrt(squared)

    def travels(self, displacements: np.ndarray) -> np.ndarray:
        """Lengths of displacements (n, d), (n,) m; to the last bit those of :meth:`travel`."""
        return np.sqrt(np.add.reduce(np.square(displacements.T * self._lever_rows)))

    def variance(self, travel: float) -> np.ndarray:
        """Variance of the noise after ``travel`` metres, (d,)."""
        return self._variance_per_metre * travel

    def sample(
        self, states: np.ndarray, displacement: np.ndarray, travel: float, rng: np.random.Generator
    ) -> np.ndarray:
        """States (P, d) moved by ``displacement`` (d,), each with an independent draw of the noise."""
        noise = rng.standard_normal(states.shape) * np.sqrt(self.variance(travel))
        return states + displacement + noise
