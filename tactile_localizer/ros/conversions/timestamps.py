"""Conversion between ROS time stamps and integer nanoseconds."""

from __future__ import annotations

from builtin_interfaces.msg import Time

from tactile_localizer.core.geometry.pose_buffer import NANOSECONDS


def to_ns(stamp: Time) -> int:
    """Nanoseconds of a time stamp; 0 means that the clock has not started."""
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def from_ns(stamp_ns: int) -> Time:
    """Time stamp of a number of nanoseconds."""
    seconds, nanoseconds = divmod(stamp_ns, NANOSECONDS)
    return Time(sec=seconds, nanosec=nanoseconds)
