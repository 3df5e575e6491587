"""Stamps of messages as integers and back."""

from __future__ import annotations

from builtin_interfaces.msg import Time

_SECOND_NS = 1_000_000_000


def to_ns(stamp: Time) -> int:
    """A message's stamp, ns; 0 means that time has not begun yet."""
    return int(stamp.sec) * _SECOND_NS + int(stamp.nanosec)


def from_ns(stamp_ns: int) -> Time:
    """The stamp of a message from ns."""
    seconds, nanoseconds = divmod(stamp_ns, _SECOND_NS)
    return Time(sec=seconds, nanosec=nanoseconds)
