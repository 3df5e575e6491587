"""Breaks in a load cell's counter: distinguishes lost samples from two senders with the same identifiers.

After a loss the counter continues from its new value. With two senders it breaks at each change of sender,
and each of the two sequences continues from where it stopped. Samples are therefore counted as lost only
after the counter has continued from its new value and the sequence before the break has not.
"""

from __future__ import annotations

from tactile_localizer.io.can.cycle import PhalanxCounts

CONFIRMATION = 3
"""Consecutive samples without a break after which the samples skipped before count as lost.

Two senders of one period alternate with at most two samples of one between two of the other.
"""

ALTERNATIONS = 8
"""Changes between two sequences that indicate two senders; losses of one sender rarely imitate so many."""


class CounterBreaks:
    """Breaks in the counter of one load cell.

    Parameters
    ----------
    counts : totals of the phalanx, in which lost samples are counted
    """

    __slots__ = ("_alternations", "_counts", "_drops", "_gaps", "_on_other", "_other", "_unbroken")

    def __init__(self, counts: PhalanxCounts) -> None:
        self._counts = counts
        self._gaps = self._drops = 0  # not yet confirmed
        self._other: int | None = None  # newest counter of the sequence before the last break
        self._on_other = False  # whether the newest frame continued it and was not used
        self._alternations = 0
        self._unbroken = 0  # samples since the last break or alternation

    @property
    def two_senders(self) -> bool:
        """Whether two sequences of counters have continued alternately."""
        return self._alternations >= ALTERNATIONS

    @property
    def totals(self) -> tuple[int, int]:
        """Gaps and drops, including those not yet confirmed."""
        return self._counts.gaps + self._gaps, self._counts.drops + self._drops

    def alternates(self, newest: int, counter: int, span: int) -> bool:
        """Whether ``counter`` changes from the sequence of the sample ``newest`` to the other one.

        Parameters
        ----------
        newest : counter of the newest sample
        counter : counter of the sample that begins
        span : number of counter values
        """
        if self._other is None:
            return False
        unbroken = (counter - newest) % span == 1
        changed = self._on_other if unbroken else (counter - self._other) % span <= 1
        if changed:
            self._alternations += 1
            self._unbroken = 0
            if self.two_senders:
                self._gaps = self._drops = 0
        return changed

    def unused(self, counter: int) -> None:
        """Record that the frame that alternated came too late to be used."""
        self._other, self._on_other = counter, True

    def begin(self, newest: int, counter: int, span: int, *, alternated: bool) -> None:
        """Record the begin of a sample, with the arguments and the result of :meth:`alternates`."""
        unbroken = (counter - newest) % span == 1
        if not unbroken:
            if not alternated:
                self.confirm()
            self._other = newest
            self._unbroken = 0
        elif not alternated:
            self._unbroken += 1
            if self._unbroken >= CONFIRMATION:
                self.confirm()
        self._on_other = False

    def skip(self, gaps: int, drops: int) -> None:
        """Record samples and frames skipped by the counter; without a break they count as lost at once."""
        if self._other is None:
            self._counts.gaps += gaps
            self._counts.drops += drops
        else:
            self._gaps += gaps
            self._drops += drops

    def confirm(self) -> None:
        """Count the skipped samples as lost, and forget the sequence before the break."""
        self._counts.gaps += self._gaps
        self._counts.drops += self._drops
        self._gaps = self._drops = 0
        self._other = None
        self._on_other = False
        self._alternations = self._unbroken = 0

    def restore(self, totals: tuple[int, int]) -> None:
        """Restore earlier :attr:`totals`, after a restart of the load cell was mistaken for lost samples."""
        gaps, drops = totals
        self._counts.gaps, self._counts.drops = min(self._counts.gaps, gaps), min(self._counts.drops, drops)
        self._gaps, self._drops = gaps - self._counts.gaps, drops - self._counts.drops
