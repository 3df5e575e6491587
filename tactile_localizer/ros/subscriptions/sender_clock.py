"""The clock that stamps messages, learned from when they come."""

from __future__ import annotations

_SECOND_NS = 1_000_000_000
_RECORDED_NS = 60 * _SECOND_NS


class SendersClock:
    """What time it is by the clock that stamps messages, learned from when they come.

    A clock that is off by less than a second is taken for the node's own, and the difference for the time
    that messages are under way. Stamps that are off by more than a minute are of a recording, whose time
    stands still between two messages.
    """

    def __init__(self) -> None:
        self._newest_ns = 0
        self._behind_ns: int | None = None
        self._era = 0

    def hear(self, stamp_ns: int, now_ns: int, era: int) -> None:
        """A message has come.

        Parameters
        ----------
        stamp_ns : its stamp, ns
        now_ns : time by the node's clock, ns; 0 where that does not run yet
        era : another number after each time that stamps were set back
        """
        if era != self._era:
            self._era, self._newest_ns, self._behind_ns = era, 0, None
        self._newest_ns = max(self._newest_ns, stamp_ns)
        if now_ns:
            behind_ns = now_ns - stamp_ns
            self._behind_ns = behind_ns if self._behind_ns is None else min(self._behind_ns, behind_ns)

    def now_ns(self, now_ns: int) -> int:
        """The time when the node's clock says ``now_ns``; not before the newest stamp. 0 before any."""
        behind_ns = self._behind_ns
        if behind_ns is None or abs(behind_ns) > _RECORDED_NS:
            return self._newest_ns
        return max(self._newest_ns, now_ns - (behind_ns if abs(behind_ns) > _SECOND_NS else 0))
