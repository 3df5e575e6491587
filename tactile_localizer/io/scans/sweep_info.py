"""Entry of a sweep in a scan file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


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
