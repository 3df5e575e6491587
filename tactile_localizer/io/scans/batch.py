"""One row of the table ``batch``: the pairs of one transaction as arrays, and the checks on reading them."""

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
    id : position in the file; batches are in the order in which they were recorded
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
        """The row of the table, in the order of :data:`COLUMNS`."""
        blobs = (
            np.ascontiguousarray(self.stamp_ns, dtype="<i8").tobytes(),
            np.ascontiguousarray(self.states, dtype="<f8").tobytes(),
            np.ascontiguousarray(self.strain, dtype="<f8").tobytes(),
        )
        ends = int(self.stamp_ns.min()), int(self.stamp_ns.max())
        columns = (self.id, self.sweep, len(self), *ends, *blobs)
        return *columns, seal_of(*columns)

    @classmethod
    def from_row(cls, row: Sequence[Any], dimension: int, channels: int) -> Batch:
        """The batch of a row, checked.

        Parameters
        ----------
        row : in the order of :data:`COLUMNS`, or of :data:`UNSEALED_COLUMNS`, whose content is checked less
        dimension : number of axes, d
        channels : number of strain channels, C

        Raises
        ------
        ValueError
            The row is damaged; says in what.
        """
        id_, sweep, pairs, *_ = row
        whole_numbers, blobs = row[:5], row[5:8]
        if any(type(value) is not int for value in whole_numbers) or pairs < 1:
            raise ValueError("expected whole numbers and at least one pair")
        sizes = 8 * pairs, 8 * pairs * dimension, 8 * pairs * channels
        if any(not isinstance(blob, bytes) for blob in blobs) or tuple(map(len, blobs)) != sizes:
            raise ValueError(f"expected arrays of {pairs} pairs")
        if len(row) > 8 and row[8] != seal_of(*row[:8]):
            raise ValueError("the checksum does not fit")
        states = np.frombuffer(blobs[1], "<f8").reshape(pairs, dimension)
        strain = np.frombuffer(blobs[2], "<f8").reshape(pairs, channels)
        require_possible(states, strain)
        return cls(id_, sweep, np.frombuffer(blobs[0], "<i8"), states, strain)


def require_possible(states: np.ndarray, strain: np.ndarray) -> None:
    """Check that positions and strains are of possible size.

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
        # The extremes are NaN where a value is: two passes without an array of the same size.
        low, high = float(values.min(initial=0.0)), float(values.max(initial=0.0))
        if not (-largest <= low and high <= largest):
            worst = low if not -largest <= low else high
            raise ValueError(f"{what}: expected finite values of at most {largest:g}, found {worst:g}")
