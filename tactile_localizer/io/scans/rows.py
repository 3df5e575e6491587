"""Rows of a scan file: entries of sweeps, batches of pairs, and their checksums ("seals").

Every row that the map depends on has a seal: 16 bytes of BLAKE2b over its other columns. The contents
seal in the header covers the seals of all sweeps, and the entry of a sweep holds the number of its
batches. A row that was changed, lost, duplicated or moved is therefore detected.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from tactile_localizer.scene import LARGEST_POSITION, LARGEST_STRAIN

SEAL_BYTES = 16

Column = int | str | bytes

BATCH_COLUMNS = "id, sweep, pairs, first_ns, last_ns, stamp_ns, states, strain, seal"
"""Columns of the table ``batch``."""

UNSEALED_BATCH_COLUMNS = "id, sweep, pairs, first_ns, last_ns, stamp_ns, states, strain"
"""Columns in files of schema version 1, which have no checksums."""


@dataclass(frozen=True)
class SweepInfo:
    """Entry of one sweep, a row of the table ``sweep``.

    Parameters
    ----------
    number : the sweep's number
    pairs : number of state-measurement pairs
    first_ns, last_ns : stamps of the first and the last pair, ns; 0 without pairs
    gaps : strain samples without a pose close enough in time
    skipped : strain samples that were missing, saturated or out of bounds
    ended : false if the recording was interrupted
    dropped : true if the user has excluded the sweep
    batches : number of rows in the table ``batch`` that belong to the sweep
    revision : number of times the entry was written; repair keeps the copy with the highest one
    """

    number: int
    pairs: int = 0
    first_ns: int = 0
    last_ns: int = 0
    gaps: int = 0
    skipped: int = 0
    ended: bool = False
    dropped: bool = False
    batches: int = 0
    revision: int = 0

    COLUMNS = "number, ended, gaps, skipped, dropped, batches, pairs, first_ns, last_ns, revision"
    """Columns of the table ``sweep``, in the order of :attr:`row`."""

    @property
    def row(self) -> tuple[int, ...]:
        """Values of the table's row, in the order of :attr:`COLUMNS`."""
        return (
            self.number,
            int(self.ended),
            self.gaps,
            self.skipped,
            int(self.dropped),
            self.batches,
            self.pairs,
            self.first_ns,
            self.last_ns,
            self.revision,
        )

    @classmethod
    def from_row(cls, row: Sequence[Any]) -> SweepInfo:
        """Validate a row of the table and make an entry of it.

        Raises
        ------
        ValueError
            The row does not hold ten integers, a flag is neither 0 nor 1, or a count is negative.
        """
        if len(row) != 10 or any(type(value) is not int for value in row):
            raise ValueError(f"expected ten integers, found {row!r:.80}")
        number, ended, gaps, skipped, dropped, batches, pairs, first_ns, last_ns, revision = row
        if {ended, dropped} - {0, 1}:
            raise ValueError(f"expected flags of 0 or 1, found {ended} and {dropped}")
        if min(gaps, skipped, batches, pairs, revision) < 0:
            raise ValueError("expected counts of at least 0, found a negative one")
        return cls(
            number, pairs, first_ns, last_ns, gaps, skipped, bool(ended), bool(dropped), batches, revision
        )


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
        """Columns of the table's row, in the order of :data:`BATCH_COLUMNS`."""
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
        row : in the order of :data:`BATCH_COLUMNS`, or :data:`UNSEALED_BATCH_COLUMNS` without checksum
        dimension : number of axes, d
        channels : number of strain channels, C

        Raises
        ------
        ValueError
            The row is damaged; the message names the defect.
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


def seal_of(*columns: Column) -> bytes:
    """Seal of a row, from its columns in order."""
    digest = hashlib.blake2b(digest_size=SEAL_BYTES)
    for column in columns:
        if isinstance(column, bytes):
            digest.update(b"b%d:" % len(column))
            digest.update(column)
        else:
            digest.update(f"{type(column).__name__}{column!r}:".encode())
    return digest.digest()


def header_seal(header: Mapping[str, str]) -> str:
    """Seal of the header's entries (text by key), excluding the seals among them."""
    entries = sorted((key, value) for key, value in header.items() if key not in ("seal", "contents"))
    return seal_of(*(text for entry in entries for text in entry)).hex()


def contents_seal(sweep_seals: Iterable[bytes]) -> str:
    """Seal of all sweeps, from their seals in the order of their numbers."""
    return seal_of("contents", *sweep_seals).hex()


def sweep_seal(sweep: SweepInfo) -> bytes:
    """Seal of a sweep's entry."""
    return seal_of("sweep", *sweep.row)


class LearnedEntry(NamedTuple):
    """A row of the table ``learned``.

    Parameters
    ----------
    key : name of the result, its algorithm and version
    digest : digest of the data that it was computed from
    payload : any bytes, for instance JSON or npz
    """

    key: str
    digest: str
    payload: bytes

    @property
    def row(self) -> tuple[Any, ...]:
        """Columns of the table's row, with the checksum."""
        return *self, seal_of(*self)
