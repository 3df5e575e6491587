"""Where one cycle ends and the next begins, in a stream of which nobody told the beginning."""

from __future__ import annotations

SURE = 3
"""Right cycles in a row after which it is sure where a cycle begins."""

DOUBT = 20
"""Wrong cycles in a row after which it no longer is: frames are late at times, and in a row of cycles too."""


class CyclePhase:
    """Tells whether cycles are cut at the pauses between them.

    Load cells send together, and then pause. A driver that begins to listen in the midst of a cycle would
    take the last samples of one and the first of the next for one. So the pause before a cycle's first
    frame is compared with the pauses within it: where one of these is more than twice as long, the cycle is
    cut in the wrong place.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Nothing is known any more."""
        self.sure = False
        self._pause_ns = 0
        self._right = False  # whether the present cycle looks right
        self._in_a_row = 0  # cycles that looked right, or wrong once it is sure

    def begin(self, pause_ns: int) -> None:
        """A cycle begins ``pause_ns`` after the frame before it; less than 0: the clock was set back."""
        self._pause_ns = max(pause_ns, 0)
        self._right = pause_ns >= 0

    def joins(self, pause_ns: int) -> bool:
        """Whether a load cell's sample, ``pause_ns`` after the frame before it, is of the present cycle."""
        if pause_ns <= 2 * self._pause_ns:
            return True
        self._right = False
        if self.sure and self._in_a_row < DOUBT:
            return True
        self.forget()
        return False

    def end(self) -> None:
        """The present cycle is over."""
        self._in_a_row = self._in_a_row + 1 if self._right != self.sure else 0
        if not self.sure and self._in_a_row == SURE:
            self.sure, self._in_a_row = True, 0
