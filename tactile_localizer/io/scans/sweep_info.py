"""Entry of one sweep in a scan file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class SweepInfo:
    """One sweep of a scan file, as its entry describes it.

    Parameters
    ----------
    number : the sweep's number
    pairs : state-measurement pairs
    first_ns, last_ns : stamps of the first and the last pair, ns; 0 without pairs
    gaps : strain samples that had no pose near enough in time
    skipped : strain samples that were missing, saturated or out of bounds
    ended : false when the recording was cut off
    dropped : true when a person has left the sweep out
    batches : rows of pairs that belong to the sweep
    revision : how often the entry was written; of several copies of a damaged file the last one counts
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
        """The entry as it is in the table."""
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
        """The entry of a row of the table.

        Raises
        ------
        ValueError
            The row does not hold ten whole numbers, a flag is neither 0 nor 1, or a count is negative.
        """
        if len(row) != 10 or any(type(value) is not int for value in row):
            raise ValueError(f"expected ten whole numbers, found {row!r:.80}")
        number, ended, gaps, skipped, dropped, batches, pairs, first_ns, last_ns, revision = row
        if {ended, dropped} - {0, 1}:
            raise ValueError(f"expected flags of 0 or 1, found {ended} and {dropped}")
        if min(gaps, skipped, batches, pairs, revision) < 0:
            raise ValueError("expected counts of at least 0, found a negative one")
        return cls(
            number, pairs, first_ns, last_ns, gaps, skipped, bool(ended), bool(dropped), batches, revision
        )
