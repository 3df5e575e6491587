"""Identifiers and lengths of CAN frames."""

from __future__ import annotations

import can

MAX_BYTES = 64
"""Data bytes of the longest CAN FD frame."""

EXTENDED = 1 << 31
"""Flag of a 29-bit identifier in a frame's key, as in SocketCAN's ``can_id``."""

REMOTE = 1 << 30
"""Flag of a remote frame in a frame's key."""

ERROR = 1 << 29
"""Flag of an error frame in a frame's key."""

_FD_LENGTHS = (12, 16, 20, 24, 32, 48, 64)


def frame_key(frame: can.Message) -> int:
    """Identifier with the flags :data:`EXTENDED`, :data:`REMOTE` and :data:`ERROR`."""
    return (
        frame.arbitration_id & 0x1FFFFFFF
        | frame.is_extended_id << 31
        | frame.is_remote_frame << 30
        | frame.is_error_frame << 29
    )


def received_ns(frame: can.Message) -> int:
    """Receive time, ns."""
    return int(frame.timestamp * 1e9)


def wire_length(length: int) -> int:
    """Data bytes of a frame for a message of ``length`` bytes; above 8, CAN FD allows only some lengths."""
    return length if length <= 8 else next(n for n in _FD_LENGTHS if n >= length)
