"""Where one cycle ends and the next begins, in a stream of which nobody told the beginning."""

from __future__ import annotations

SURE = 3
"""Cycles in a row that must be alike before they are believed, or disbelieved."""


class CyclePhase:
    """Tells whether cycles are cut at the pauses between them.

    Load cells send together, and then pause. A driver that begins to listen in the midst of a cycle would
    take the last samples of one and the first of the next for one. So the pause before a cycle's first
    frame is compared with the pauses within it: where one of these is more than twice as long, the cycle is
    cut in the wrong place. Cycles are believed after :data:`SURE` right ones; once believed, it takes as
    many wrong ones to doubt them, since frames are late at times.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Nothing is known any more."""
        self.sure = False
        self._votes = 0
        self._right = False  # whether the present cycle looks right
        self._pause_ns = 0

    def begin(self, pause_ns: int) -> None:
        """A cycle begins ``pause_ns`` after the frame before it; 0 or less: nobody knows."""
        self._pause_ns = pause_ns
        self._right = pause_ns > 0

    def joins(self, pause_ns: int) -> bool:
        """Whether a load cell's sample, ``pause_ns`` after the frame before it, is of the present cycle."""
        if self._pause_ns <= 0 or pause_ns <= 2 * self._pause_ns:
            return True
        if self._right:
            self._right = False
            self._votes -= 1
        if self.sure and self._votes > 0:
            return True
        self.forget()
        return False

    def end(self) -> None:
        """The present cycle is over."""
        if self._right:
            self._votes = min(self._votes + 1, SURE)
            self.sure = self.sure or self._votes == SURE
