"""Strain of a scene's phalanges from ``StrainVectors`` messages, received by rclpy or read by rosbags."""

from typing import Any

import numpy as np

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.errors import MeasurementError
from tactile_localizer.scene import Scene

_RESTART = 1_000_000
"""Forward step of the sequence number that indicates a restart of the load cells or the driver, cycles."""


class StrainReader:
    """Extracts the phalanges of a scene from ``StrainVectors`` messages, which may contain others.

    Parameters
    ----------
    scene : scene that names the phalanges

    Attributes
    ----------
    lost : number of strain vectors lost in transport, from gaps in the sequence numbers. DDS silently drops
        the oldest message of a full queue, so only this count reveals a reader that is too slow
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._names: tuple[str, ...] | None = None
        self._counts: tuple[int, ...] = ()
        self._sequence: int | None = None
        self.lost = 0

    def read(self, message: Any) -> tuple[np.ndarray, np.ndarray]:
        """Strain voltages (C,), V, and status bits (F,) uint8.

        Raises
        ------
        SceneError
            The message lacks a phalanx of the scene.
        MeasurementError
            The lengths of its arrays are inconsistent.
        """
        self._count(max(map(int, message.sequence), default=None))
        names, counts = tuple(message.phalanges), tuple(message.channels)
        if names != self._names or counts != self._counts:
            self._look_up(names, counts)
        n, size = len(names), self._size
        if len(message.strain) != size or len(message.status) != n:
            raise MeasurementError(
                f"strain vector of {n} phalanges: expected {size} voltages and {n} status values, "
                f"got {len(message.strain)} and {len(message.status)}"
            )
        strain = np.asarray(message.strain, dtype=np.float64)[self._channels]
        return strain, np.asarray(message.status, dtype=np.uint8)[self._rows]

    def _look_up(self, names: tuple[str, ...], counts: tuple[int, ...]) -> None:
        """Find the phalanges of the scene in messages of ``names`` with ``counts`` channels."""
        if counts and len(counts) != len(names):
            raise MeasurementError(
                f"strain vector of {len(names)} phalanges: expected as many channel counts, or none, "
                f"got {len(counts)}"
            )
        self._channels, self._rows = self._scene.channels(names, counts), self._scene.rows(names)
        self._size = ChannelLayout.of(counts, len(names)).size
        self._names, self._counts = names, counts

    def _count(self, sequence: int | None) -> None:
        if sequence is not None and self._sequence is not None:
            step = sequence - self._sequence
            if 0 < step < _RESTART:
                self.lost += step - 1
            elif step < 0:  # a restart, or one of two publishers, between which a gap means nothing
                sequence = None
        self._sequence = sequence
