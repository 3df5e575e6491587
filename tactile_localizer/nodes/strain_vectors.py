"""Strain vectors from messages, in the order of a scene's phalanges."""

from __future__ import annotations

import numpy as np

from tactile_localizer.errors import MeasurementError
from tactile_localizer.msg import StrainVectors
from tactile_localizer.scene import GAUGES, Scene


class StrainReader:
    """Picks a scene's phalanges out of :class:`StrainVectors` messages, which may hold others too.

    Parameters
    ----------
    scene : names the phalanges
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._names: tuple[str, ...] | None = None

    def read(self, message: StrainVectors) -> tuple[np.ndarray, np.ndarray]:
        """Strain voltages (8F,), V, and status bits (F,) uint8.

        Raises
        ------
        SceneError
            The message does not have all of the scene's phalanges.
        MeasurementError
            The lengths of its arrays do not fit each other.
        """
        names = tuple(message.phalanges)
        if names != self._names:
            self._channels = self._scene.channels(names)
            self._rows = self._channels[::GAUGES] // GAUGES
            self._names = names
        n = len(names)
        if len(message.strain) != GAUGES * n or len(message.status) != n:
            raise MeasurementError(
                f"strain vector of {n} phalanges: expected {GAUGES * n} voltages and {n} status values, "
                f"got {len(message.strain)} and {len(message.status)}"
            )
        strain = np.asarray(message.strain, dtype=np.float64)[self._channels]
        return strain, np.asarray(message.status, dtype=np.uint8)[self._rows]
