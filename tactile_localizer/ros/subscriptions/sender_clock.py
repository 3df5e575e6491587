"""Estimate of the current time on the clock that stamps the messages."""

from __future__ import annotations

from collections.abc import Callable

from tactile_localizer.core.geometry.pose_buffer import NANOSECONDS

_RECORDED_NS = 60 * NANOSECONDS


class SenderClock:
    """Estimates the time of the sender from the stamps and the arrival times of messages.

    An offset of less than one second is taken for transport delay: sender and node share a clock. An offset
    of more than one minute indicates a recording, whose time stands still between two messages.

    Parameters
    ----------
    receiver_ns : returns the time of the node's clock, ns; 0 if it has not started
    """

    def __init__(self, receiver_ns: Callable[[], int]) -> None:
        self._receiver_ns = receiver_ns
        self._newest_ns = 0
        self._delay_ns: int | None = None
        self._epoch = 0

    def update(self, stamp_ns: int, epoch: int) -> None:
        """Account for a message that arrives now.

        Parameters
        ----------
        stamp_ns : stamp of the message, ns
        epoch : number of backward jumps of the stamps so far
        """
        if epoch != self._epoch:
            self._epoch, self._newest_ns, self._delay_ns = epoch, 0, None
        self._newest_ns = max(self._newest_ns, stamp_ns)
        if receiver_ns := self._receiver_ns():
            delay_ns = receiver_ns - stamp_ns
            self._delay_ns = delay_ns if self._delay_ns is None else min(self._delay_ns, delay_ns)

    @property
    def now_ns(self) -> int:
        """Stamp of a message sent now, ns; at least the newest stamp, 0 before any.

        Messages with older stamps can still arrive.
        """
        delay_ns = self._delay_ns
        if delay_ns is None or abs(delay_ns) > _RECORDED_NS:
            return self._newest_ns
        offset_ns = delay_ns if abs(delay_ns) > NANOSECONDS else 0
        return max(self._newest_ns, self._receiver_ns() - offset_ns)
