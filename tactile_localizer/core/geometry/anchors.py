"""Anchors: centres of the boxes of a lattice over the scene that moves with the palm."""

import numpy as np

from tactile_localizer.core import compiled
from tactile_localizer.core.geometry.motion import MotionModel, levers
from tactile_localizer.scene import Scene

_COUNT = 200
"""Number of boxes, about."""
_LEAST_PITCH = 0.001
"""Least size of a box, m: a filter's cells are smaller."""


class Anchors:
    """Trajectories that represent the whole map, whatever the belief.

    What leaves the scene at one bound returns at the opposite one.

    Parameters
    ----------
    scene : bounds of the state

    Attributes
    ----------
    pitch : (d,) size of the boxes, m (yaw: rad)
    states : (R, d) their centres
    """

    states: np.ndarray

    def __init__(self, scene: Scene) -> None:
        # An axis at a time: arrays with a short last axis take several times longer.
        self._lower, self._extent = scene.lower[:, None], scene.extent[:, None]
        self._ends = ~scene.wraps[:, None]
        self._motion, self._levers = MotionModel(scene), levers(scene)
        extent = scene.extent * self._levers
        pitch = max((float(np.prod(extent)) / _COUNT) ** (1.0 / scene.dimension), _LEAST_PITCH)
        self._counts = np.clip(np.rint(extent / pitch), 1, _COUNT).astype(int)
        self.pitch = scene.extent / self._counts
        index = np.indices(self._counts).reshape(scene.dimension, -1)
        self._origin = (index + 0.5) * self.pitch[:, None]
        self.reset()

    def __len__(self) -> int:
        return self._origin.shape[1]

    def reset(self) -> None:
        """Return to where they began."""
        self._shift = np.zeros_like(self._extent)
        self._beyond = np.zeros(self._origin.shape, dtype=bool)
        self.states = (self._lower + self._origin).T

    def far_from(self, place: np.ndarray, distance: float, values: np.ndarray) -> np.ndarray:
        """The ``values`` (R,) of the anchors that are farther from a ``place`` (d,) than that; else -inf.

        The distance, m, counts yaw by :data:`.YAW_LEVER`.
        """
        if compiled.MODULE is not None:
            found = np.empty(len(self))
            compiled.MODULE.far_from(self.states.T, place, self._levers, distance, values, found)
            return found
        return np.where(self._motion.travels(self.states - place) > distance, values, -np.inf)

    def move(self, displacement: np.ndarray) -> np.ndarray:
        """Move by ``displacement`` (d,), m (yaw: rad); returns which anchors (R,) bool left at a bound."""
        if compiled.MODULE is not None:
            self.states, left = np.empty(self._origin.shape).T, np.empty(len(self), dtype=bool)
            given = self._origin, displacement, self._lower, self._extent, self._ends
            compiled.MODULE.anchors(*given, self._shift, self._beyond, self.states.T, left)
            return left
        before, moved = self._beyond, self._shift + displacement[:, None]
        self._shift = np.mod(moved, self._extent)
        turns = np.rint((moved - self._shift) / self._extent)
        places = self._origin + self._shift
        # np.mod takes ten times as long.
        self._beyond = places >= self._extent
        self.states = (self._lower + (places - self._beyond * self._extent)).T
        return np.logical_or.reduce((before != self._beyond + turns) & self._ends)
