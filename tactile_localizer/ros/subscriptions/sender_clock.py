"""Estimate of the current time on the clock that stamps the messages."""

from __future__ import annotations

from tactile_localizer.core.geometry.pose_buffer import NANOSECONDS

_RECORDED_NS = 60 * NANOSECONDS


class SenderClock:
    """Estimates the sender's time from the stamps and the arrival times of messages.

    An offset of less than one second is taken for transport delay: sender and node share a clock. An offset
    of more than one minute indicates a recording, whose time stands still between two messages.
    """

    def __init__(self) -> None:
        self._newest_ns = 0
        self._delay_ns: int | None = None
        self._epoch = 0

    def update(self, stamp_ns: int, now_ns: int, epoch: int) -> None:
        """Account for the arrival of a message.

        Parameters
        ----------
        stamp_ns : stamp of the message, ns
        now_ns : time of the node's clock, ns; 0 if it has not started
        epoch : number of backward jumps of the stamps so far
        """
        if epoch != self._epoch:
            self._epoch, self._newest_ns, self._delay_ns = epoch, 0, None
        self._newest_ns = max(self._newest_ns, stamp_ns)
        if now_ns:
            delay_ns = now_ns - stamp_ns
            self._delay_ns = delay_ns if self._delay_ns is None else min(self._delay_ns, delay_ns)

    def now_ns(self, now_ns: int) -> int:
        """Sender time when the node's clock shows ``now_ns``; at least the newest stamp, 0 before any."""
        delay_ns = self._delay_ns
        if delay_ns is None or abs(delay_ns) > _RECORDED_NS:
            return self._newest_ns
        return max(self._newest_ns, now_ns - (delay_ns if abs(delay_ns) > NANOSECONDS else 0))
