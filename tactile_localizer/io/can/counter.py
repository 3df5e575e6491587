"""Rolling counter of the frames of one message, whatever it counts.

Most counters advance by one per sample. Others count all frames, the samples inside the sensor or
microseconds, and many wrap before their bits do. How far a counter usually advances is learned, and when it
wraps.
"""

TWO_SENDERS = "two load cells with its identifiers"
"""Most likely reason why a counter does not count."""

MAX_LATE = 2
"""Most samples by which a frame is taken as late; further behind, the counter jumped."""

_LEARNED_FROM = 8
"""Frames in a row that do not advance as usual, from which the usual advance is learned."""

_SHORTEST_TIMER = 4
"""Smallest usual advance that may vary, by a quarter of itself, as a time does."""


class RollingCounter:
    """Counter of the frames of one message.

    Parameters
    ----------
    span : number of its values, as far as known

    Attributes
    ----------
    newest : value of the newest frame; ``None`` before the first
    span : number of its values
    step : usual advance from frame to frame; 0 if it is unusable
    problem : reason why it is unusable, continuing "the counter"; else empty
    is_sure : whether a frame has advanced by ``step``; before, no frame is late or lost
    jumps : number of frames that neither follow the previous one nor show losses that the time explains
    """

    def __init__(self, span: int) -> None:
        self.newest: int | None = None
        self.span, self.step = span, 1
        self.problem = ""
        self.is_sure = False
        self.jumps = 0
        self._unusual: list[int] = []  # advances since the last usual one
        self._lowest, self._highest = span, 0

    def follows(self, value: int) -> bool:
        """Whether a frame follows the newest exactly; then it is the newest."""
        if self.newest is None or not self.step or (value - self.newest - self.step) % self.span:
            return False
        if value < self.newest:
            self._note_ends(value)
        self.newest, self.is_sure = value, True
        if self._unusual:
            self._unusual.clear()
        return True

    def advance(self, value: int, expected: float, longest: float) -> int:
        """Samples by which a frame is ahead of the newest; if it is, it is the newest from now on.

        More than one: the samples between were lost. 0: repeated. Negative: of an earlier sample.

        Parameters
        ----------
        value : of the frame
        expected : number of samples since the newest frame, which tells how often the counter wrapped
        longest : number of samples that can have been sent since then; what exceeds it is not lost
        """
        if self.newest is None:
            self.newest = value
            self._note_ends(value)
            return 1
        samples = self._judge(value, expected, longest)
        if samples > 0:
            self.newest = value
        return samples

    def ahead_of(self, value: int, other: int, due: int = 0) -> int:
        """How far ``value`` is ahead of ``other``, of the possible answers the nearest to ``due``."""
        half = self.span // 2
        return due + (value - other - due + half) % self.span - half

    def _judge(self, value: int, expected: float, longest: float) -> int:
        assert self.newest is not None
        step = self.step or 1
        ahead = self.ahead_of(value, self.newest, round(expected) * step)
        samples = round(ahead / step)
        if self.step and _is_multiple(ahead, step) and 1 <= samples <= max(1.0, 1.05 * longest + 0.5):
            self.is_sure |= samples == 1
            if samples == 1 or ahead not in self._unusual:
                self._unusual.clear()
            if samples > 1:
                self._add_unusual(ahead)  # the same loss again and again is the usual advance
            return samples if self.is_sure else 1
        is_late = self.is_sure and -min(MAX_LATE * step, self.span // 4) <= ahead <= 0
        if not is_late and self._wraps(value, longest):
            return 1
        is_held = not ahead and round(expected) > 0  # of another sample, before which it did not advance
        self.jumps += self.is_sure and not is_late
        self._add_unusual(ahead)
        return samples if is_late and not is_held else 1

    def _wraps(self, value: int, longest: float) -> bool:
        """Whether the counter began again with its lowest value after its highest, in time."""
        assert self.newest is not None
        lowest, highest = self._lowest, max(self._highest, self.newest)
        self._note_ends(value)
        at_ends = value < lowest + self.step and self.newest > highest - self.step
        is_run = self.is_sure and self.newest - value >= _LEARNED_FROM * self.step - 1
        if not at_ends or not is_run or longest >= 1.5:
            return False
        if self.step < _SHORTEST_TIMER:
            self.span = self.newest + self.step - value
        return True

    def _note_ends(self, value: int) -> None:
        """Note the lowest and highest values: those before and after the counter began a new run."""
        assert self.newest is not None
        self._lowest, self._highest = min(self._lowest, value), max(self._highest, self.newest)

    def _add_unusual(self, ahead: int) -> None:
        self._unusual.append(ahead)
        if len(self._unusual) < _LEARNED_FROM:
            return
        found, self._unusual = sorted(self._unusual), []
        step = found[len(found) // 2]
        multiples = sum(one > 0 and _is_multiple(one, step) for one in found) if step > 0 else 0
        self.is_sure = False
        self.step, self.problem = step, ""
        if multiples < 0.75 * len(found):
            self.step = 0
            self.problem = (
                f"advances by {found[0]} to {found[-1]} ({TWO_SENDERS}, or no count)"
                if any(found)
                else f"is always {self.newest}"
            )


def _is_multiple(ahead: int, step: int) -> bool:
    """Whether a counter that usually advances by ``step`` can have advanced by ``ahead``."""
    return _SHORTEST_TIMER * abs(ahead - round(ahead / step) * step) <= step
