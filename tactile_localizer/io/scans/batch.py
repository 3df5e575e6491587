"""Rows of the table ``batch``: the pairs of one transaction as arrays, validated on reading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_localizer.io.scans.seals import seal_of
from tactile_localizer.scene import LARGEST_POSITION, LARGEST_STRAIN

COLUMNS = "id, sweep, pairs, first_ns, last_ns, stamp_ns, states, strain, seal"
UNSEALED_COLUMNS = "id, sweep, pairs, first_ns, last_ns, stamp_ns, states, strain"
"""Columns in files of schema version 1, which have no checksums."""


@dataclass(frozen=True)
class Batch:
    """Consecutive pairs of one sweep.

    Parameters
    ----------
    id : position in the file, in order of recording
    sweep : number of the sweep
    stamp_ns : (n,) int64 stamps, ns
    states : (n, d) palm positions, m (yaw: rad)
    strain : (n, C) strain, in the unit of the file
    """

    id: int
    sweep: int
    stamp_ns: np.ndarray
    states: np.ndarray
    strain: np.ndarray

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @property
    def row(self) -> tuple[Any, ...]:
        """Columns of the table's row, in the order of :data:`COLUMNS`."""
        blobs = (
            np.ascontiguousarray(self.stamp_ns, dtype="<i8").tobytes(),
            np.ascontiguousarray(self.states, dtype="<f8").tobytes(),
            np.ascontiguousarray(self.strain, dtype="<f8").tobytes(),
        )
        first_ns, last_ns = int(self.stamp_ns.min()), int(self.stamp_ns.max())
        columns = (self.id, self.sweep, len(self), first_ns, last_ns, *blobs)
        return *columns, seal_of(*columns)

    @classmethod
    def from_row(cls, row: Sequence[Any], dimension: int, channels: int) -> Batch:
        """Validate a row and make a batch of it.

        Parameters
        ----------
        row : in the order of :data:`COLUMNS`, or of :data:`UNSEALED_COLUMNS`, which has no checksum
        dimension : number of axes, d
        channels : number of strain channels, C

        Raises
        ------
        ValueError
            The row is damaged; the message says how.
        """
        id_, sweep, pairs, *_ = row
        integers, blobs = row[:5], row[5:8]
        if any(type(value) is not int for value in integers) or pairs < 1:
            raise ValueError("expected integers and at least one pair")
        sizes = 8 * pairs, 8 * pairs * dimension, 8 * pairs * channels
        if any(not isinstance(blob, bytes) for blob in blobs) or tuple(map(len, blobs)) != sizes:
            raise ValueError(f"expected arrays of {pairs} pairs")
        if len(row) > 8 and row[8] != seal_of(*row[:8]):
            raise ValueError("the checksum does not match")
        states = np.frombuffer(blobs[1], "<f8").reshape(pairs, dimension)
        strain = np.frombuffer(blobs[2], "<f8").reshape(pairs, channels)
        require_plausible(states, strain)
        return cls(id_, sweep, np.frombuffer(blobs[0], "<i8"), states, strain)


def require_plausible(states: np.ndarray, strain: np.ndarray) -> None:
    """Require that positions and strains are finite and of plausible magnitude.

    Raises
    ------
    ValueError
        A value is not finite, or beyond :data:`~tactile_localizer.scene.LARGEST_POSITION` or
        :data:`~tactile_localizer.scene.LARGEST_STRAIN`.
    """
    for what, values, largest in (
        ("position", states, LARGEST_POSITION),
        ("strain", strain, LARGEST_STRAIN),
    ):
        # Minimum and maximum are NaN if any value is, so no temporary array of the same size is needed.
        low, high = float(values.min(initial=0.0)), float(values.max(initial=0.0))
        if not (-largest <= low and high <= largest):
            worst = low if not -largest <= low else high
            raise ValueError(f"{what}: expected finite values of at most {largest:g}, found {worst:g}")
