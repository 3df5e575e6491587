"""Where one cycle ends and the next begins, in a stream of which nobody told the beginning."""

from __future__ import annotations

SURE = 3
"""Right cycles in a row after which it is sure where a cycle begins."""

TRUST = 20
"""Most that right cycles can add up to against wrong ones: frames are late at times, and in a row of cycles
too."""


class CyclePhase:
    """Tells whether cycles are cut at the pauses between them.

    Load cells send together, and then pause. A driver that begins to listen in the midst of a cycle would
    take the last samples of one and the first of the next for one. So the pause before a cycle's first
    frame is compared with the pauses within it: where one of these is more than twice as long, the cycle is
    cut in the wrong place. Once it is sure where a cycle begins, right cycles outweigh as many wrong ones.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Nothing is known any more."""
        self.sure = False
        self._pause_ns = 0
        self._right = False  # whether the present cycle looks right
        self._balance = 0  # cycles that looked right: in a row, or less wrong ones once it is sure

    def begin(self, pause_ns: int) -> None:
        """A cycle begins ``pause_ns`` after the frame before it; less than 0: the clock was set back."""
        self._pause_ns = max(pause_ns, 0)
        self._right = pause_ns >= 0

    def joins(self, pause_ns: int) -> bool:
        """Whether a load cell's sample, ``pause_ns`` after the frame before it, is of the present cycle."""
        if pause_ns <= 2 * self._pause_ns:
            return True
        self._right = False
        if self.sure and self._balance > 0:
            return True
        self.forget()
        return False

    def admits(self, pause_ns: int) -> bool:
        """The same of a load cell that was in no cycle lately: not after a pause like the cycle's own."""
        return not self.sure or 2 * pause_ns <= self._pause_ns

    def end(self) -> None:
        """The present cycle is over."""
        if self.sure:
            self._balance = min(self._balance + 1, TRUST) if self._right else max(self._balance - 1, 0)
        else:
            self._balance = self._balance + 1 if self._right else 0
            self.sure = self._balance >= SURE
