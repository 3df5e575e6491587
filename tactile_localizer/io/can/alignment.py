"""Alignment of the load cells' counters, which assigns samples to cycles.

Every load cell counts its samples and sends one per cycle, so the number of a sample's cycle is its counter
plus an offset, modulo the counter's span. The offset changes only when a load cell restarts or its clock
drifts by a period. It is estimated from the pauses between cycles: of all pauses between two samples of one
load cell (the reference), the longest marks the end of a cycle. Each period gives one vote for one offset
per load cell. A single vote may be wrong, because a busy machine stretches any pause; an offset is used as
soon as, and as long as, it leads by :data:`CERTAIN_LEAD` votes.
"""

from __future__ import annotations

from collections.abc import Sequence

CERTAIN_LEAD = 12
"""Lead in votes that an offset needs before it is used.

If one vote in four is wrong, the wrong offset reaches it first with a probability of 3**-12 = 2e-6.
"""

MAX_VOTES = 64
"""Votes after which all counts are halved, so that a load cell with a drifting clock is realigned in time."""

BITS_PER_VOTE = 1.6
"""Bits of a counter with the expected value that are worth one vote (log2 of 3, as above)."""

SHORTEST_PAUSE_NS = 250_000
"""Shortest pause that can separate two cycles, ns: two classic frames at 1 Mbit/s. Shorter pauses occur
between frames that a driver reads together."""

MAX_ABSENCE = 8
"""Cycles without a sample after which a load cell may have restarted, whatever its counter."""

MAX_LATENESS = 2
"""Most cycles that a frame can be late. A counter further behind is interpreted as ahead, after losses."""

_CHANCE_SPAN = 256
"""Longest span of a counter that may match its old offset by chance after a restart."""

_USUAL_PLACE = 16
"""Balance of samples in the same place of the cycle from which that place is the usual one."""

_MAX_PLACE = 32
"""Largest balance, so that a changed order is learned in time."""

_OTHER_PLACE = 16
"""Reduction of the balance by one sample in the other place."""


class LoadCellCounter:
    """Counter of one load cell and its offset to the number of the cycle.

    Attributes
    ----------
    span : number of counter values
    max_lateness : most cycles that a sample can be late; less than :data:`MAX_LATENESS` for short spans
    certain : whether the offset is certain
    """

    __slots__ = (
        *("certain", "max_lateness", "samples", "span"),
        *("_break", "_expected", "_head_start", "_offset", "_place", "_total", "_votes"),
    )

    def __init__(self, bits: int) -> None:
        self.span = 1 << bits
        self.max_lateness = min(MAX_LATENESS, self.span // 4)
        self._head_start = int(bits / BITS_PER_VOTE)
        self.certain = False
        self.samples = 0  # since the newest sample of the reference
        self._offset: int | None = None
        self._expected: int | None = None  # offset with the head start
        self._votes: dict[tuple[int, LoadCellCounter], int] = {}  # by offset and first load cell of the cycle
        self._total = 0
        self._place = 0  # times first in its cycle minus times not first, within _MAX_PLACE
        self._break = 0  # cycles for which a break in the counter is remembered

    def cycle(self, counter: int, earliest: int) -> int:
        """Number of the first cycle from ``earliest`` on to which a sample with ``counter`` can belong."""
        assert self._offset is not None
        return earliest + (counter + self._offset - earliest) % self.span

    def expect_same_count(self, other: LoadCellCounter) -> None:
        """Give the offset of ``other`` a head start before the first vote; counters often start together."""
        if self._offset is None and self._expected is None and not self._votes and self.span == other.span:
            self._expected = other._offset

    def lead(self, counter: int, cycle: int) -> None:
        """Set the offset without votes: keep the last one, or else put ``counter`` in ``cycle``."""
        if self._offset is None:
            self._offset = (cycle - counter) % self.span
        self._clear_votes()
        self.certain = True
        self._break = 0

    def vote(self, counter: int, cycle: int, first: LoadCellCounter) -> None:
        """Count one vote for ``counter`` in ``cycle``, with ``first`` as the first load cell of a cycle.

        Votes for an offset are counted separately for each first load cell. Random pauses are distributed
        evenly over all places; summed up, all but one of them would put the last load cell a cycle too late.
        """
        offset = (cycle - counter) % self.span
        self._votes[offset, first] = self._votes.get((offset, first), 0) + 1
        self._total += 1
        if self._total > MAX_VOTES:
            self._votes = {key: count // 2 for key, count in self._votes.items() if count > 1}
            self._total = sum(self._votes.values())
        if self.certain and offset == self._offset:
            return
        score: dict[int, int] = {}
        for (voted, _), count in self._votes.items():
            score[voted] = max(score.get(voted, 0), count)
        if self._expected is not None:
            score[self._expected] = score.get(self._expected, 0) + self._head_start
        best = max(score, key=score.__getitem__)
        if self.certain:
            self.certain = score.get(self._offset or 0, 0) >= score[best]
            return
        rival = max((count for voted, count in score.items() if voted != best), default=0)
        if score[best] - rival >= CERTAIN_LEAD and 2 * score[best] >= 5 * rival:
            self._offset, self.certain, self._break = best, True, 0

    def doubt(self) -> None:
        """Mark the offset as uncertain; the last offset keeps a head start in the votes."""
        self.certain = False
        self._clear_votes()

    def forget(self) -> None:
        """Discard the offset, as after a restart."""
        self.certain = False
        self._offset = None
        self._clear_votes()

    def broken(self) -> None:
        """Record that the counter did not increase by one: samples were lost, or the load cell restarted."""
        if self.span <= _CHANCE_SPAN:
            self._break = MAX_ABSENCE

    def admits(self, first: bool, late: bool) -> bool:
        """Whether a sample, first in its cycle or not, is in the usual place of the load cell's samples.

        A restarted counter may match its old offset by chance, one cycle off. The order within the cycle
        then changes: a load cell that used to be first no longer is, or vice versa. So a sample after a
        break in the counter must be in the usual place, or else its offset becomes uncertain. A sample that
        is ``late`` in its cycle after a break is itself skipped, because another load cell may be silent, and
        so is one without a break that is not first although it usually is.
        """
        usual = self._place if first else -self._place
        if self._break:
            if late:
                return False
            self._break -= 1
            if usual < _USUAL_PLACE:
                self.doubt()
            return self.certain
        if not first and usual <= -_USUAL_PLACE and self.span <= _CHANCE_SPAN:
            self._break = MAX_ABSENCE
            return False
        return True

    def placed(self, first: bool) -> None:
        """Record whether a sample was first in a cycle of several load cells."""
        place = self._place if first else -self._place
        place = min(place + 1, _MAX_PLACE) if place >= 0 else min(place + _OTHER_PLACE, 0)
        self._place = place if first else -place

    def forget_place(self) -> None:
        """Forget the usual place, for instance because another load cell has joined."""
        self._place = 0

    def _clear_votes(self) -> None:
        self._expected = self._offset
        self._votes = {}
        self._total = 0


class Alignment:
    """Offsets of the counters of all load cells.

    Parameters
    ----------
    bits : width of each load cell's counter; 0 for load cells without a counter, which are not aligned
    """

    def __init__(self, bits: Sequence[int]) -> None:
        self.counters = [LoadCellCounter(width) if width else None for width in bits]
        self._counting = [counter for counter in self.counters if counter is not None]
        self._reference: LoadCellCounter | None = None
        self._reference_cycle: int | None = None
        self._starts: list[tuple[LoadCellCounter, int, int]] = []  # samples since the reference's newest

    def reset(self) -> None:
        """Mark all offsets as uncertain, as after a pause in reception."""
        for one in self._counting:
            one.doubt()
        self._refer_to(None)

    def alone(self, one: LoadCellCounter) -> bool:
        """Whether no load cell but ``one`` has a certain offset."""
        return not any(other.certain for other in self._counting if other is not one)

    def begin(self, one: LoadCellCounter, counter: int, pause_ns: int, earliest: int) -> None:
        """Update the offsets with the first frame of a sample.

        Parameters
        ----------
        one : counter of the load cell
        counter : value of its counter
        pause_ns : time since the previous frame of any load cell, ns; negative after a step of the clock
        earliest : first cycle to which the sample can belong
        """
        self.revise()
        reference = self._reference
        if reference is None:
            one.lead(counter, earliest)
            self._refer_to(one)
            reference = one
        if one is reference:
            cycle = one.cycle(counter, earliest)
            if self._reference_cycle is not None and cycle == self._reference_cycle + 1:
                self._vote(reference, self._reference_cycle, pause_ns)
            self._reference_cycle = cycle
            self._restart_period()
            return
        one.expect_same_count(reference)
        self._starts.append((one, counter, pause_ns))
        one.samples += 1
        if one.samples > MAX_ABSENCE:  # the reference is silent
            other = next((o for o in self._counting if o.certain and o is not reference), None)
            if other is None:
                reference.doubt()
            self._refer_to(other)

    def revise(self) -> None:
        """Choose another reference if the current one is no longer certain."""
        if self._reference is not None and not self._reference.certain:
            self._refer_to(next((one for one in self._counting if one.certain), None))

    def _refer_to(self, one: LoadCellCounter | None) -> None:
        self._reference, self._reference_cycle = one, None
        self._restart_period()

    def _restart_period(self) -> None:
        self._starts = []
        for one in self._counting:
            one.samples = 0

    def _vote(self, reference: LoadCellCounter, cycle: int, last_pause_ns: int) -> None:
        pauses = [pause_ns for _, _, pause_ns in self._starts] + [last_pause_ns]
        longest = max(pauses)
        if longest < SHORTEST_PAUSE_NS or min(pauses) < 0:
            return
        end = pauses.index(longest)
        first = self._starts[end][0] if end < len(self._starts) else reference
        certain = [one.certain for one, _, _ in self._starts]
        for place, (one, counter, _) in enumerate(self._starts):
            one.vote(counter, cycle + (place >= end), first)
        if any(one.certain > before for (one, _, _), before in zip(self._starts, certain, strict=True)):
            for one in self._counting:
                one.forget_place()
