"""Anchors: centres of the boxes of a lattice over the scene that moves with the palm."""

from typing import NamedTuple

import numpy as np

from tactile_localizer.core.geometry.motion import levers
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
        self._lower, self._extent = scene.lower, scene.extent
        extent = self._extent * levers(scene)
        pitch = max((float(np.prod(extent)) / _COUNT) ** (1.0 / scene.dimension), _LEAST_PITCH)
        self._counts = np.clip(np.rint(extent / pitch), 1, _COUNT).astype(int)
        self.pitch = self._extent / self._counts
        index = np.indices(self._counts).reshape(scene.dimension, -1).T
        self._origin = (index + 0.5) * self.pitch
        self.reset()

    def __len__(self) -> int:
        return len(self._origin)

    def reset(self) -> None:
        """Return to where they began."""
        self._shift = np.zeros(len(self._extent))
        self.move(self._shift)

    def move(self, displacement: np.ndarray) -> None:
        """Move by ``displacement`` (d,), m (yaw: rad)."""
        self._shift = np.mod(self._shift + displacement, self._extent)
        moved = self._origin + self._shift
        # np.mod takes ten times as long.
        self.states = self._lower + np.where(moved < self._extent, moved, moved - self._extent)

    def index(self, states: np.ndarray) -> np.ndarray:
        """Index (P,) of the box in which each of ``states`` (P, d) is."""
        relative = (states - self._lower - self._shift).T
        index = np.zeros(len(states))
        for along, extent, pitch, count in zip(
            relative, self._extent, self.pitch, self._counts.tolist(), strict=True
        ):
            along += extent * (along < 0.0)
            index *= count
            index += np.minimum((along / pitch).astype(np.intp), count - 1)
        return np.maximum(index, 0.0).astype(np.intp)


class Injection(NamedTuple):
    """Belief that a filter takes in, uniform within each anchor's box.

    Parameters
    ----------
    fraction : of the filter's belief that it replaces
    anchors : the boxes
    weights : (R,) of the boxes, with a sum of one
    """

    fraction: float
    anchors: Anchors
    weights: np.ndarray
