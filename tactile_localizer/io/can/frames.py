"""Batches of CAN frames as arrays, for vectorised decoding."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import can
import numpy as np

MAX_BYTES = 64
"""Data bytes of the longest CAN FD frame."""

EXTENDED = 1 << 31
"""Flag of a 29-bit identifier in a frame's key, as in SocketCAN's ``can_id``."""

REMOTE = 1 << 30
"""Flag of a remote frame in a frame's key."""

ERROR = 1 << 29
"""Flag of an error frame in a frame's key."""

_FD_LENGTHS = (12, 16, 20, 24, 32, 48, 64)


@dataclass(frozen=True)
class FrameBatch:
    """Frames in order of reception.

    Attributes
    ----------
    key : (N,) uint32 identifiers with the flags :data:`EXTENDED`, :data:`REMOTE`, :data:`ERROR`
    stamp_ns : (N,) int64 receive times, ns
    length : (N,) int64 data bytes
    data : (N, W) uint8 data, padded with zeros or truncated to W bytes
    """

    key: np.ndarray
    stamp_ns: np.ndarray
    length: np.ndarray
    data: np.ndarray

    def __len__(self) -> int:
        return len(self.key)

    @classmethod
    def from_messages(cls, messages: Sequence[can.Message], width: int = MAX_BYTES) -> FrameBatch:
        """Convert python-can ``messages``, with ``width`` bytes of data each."""
        key = [
            m.arbitration_id & 0x1FFFFFFF
            | m.is_extended_id << 31
            | m.is_remote_frame << 30
            | m.is_error_frame << 29
            for m in messages
        ]
        data = b"".join(
            [m.data if len(m.data) == width else m.data.ljust(width, b"\0")[:width] for m in messages]
        )
        return cls(
            key=np.array(key, dtype=np.uint32),
            stamp_ns=(np.array([m.timestamp for m in messages], dtype=float) * 1e9).astype(np.int64),
            length=np.array([len(m.data) for m in messages], dtype=np.int64),
            data=np.frombuffer(data, dtype=np.uint8).reshape(len(messages), width),
        )


def wire_length(length: int) -> int:
    """Data bytes of a frame for a message of ``length`` bytes; above 8, CAN FD allows only some lengths."""
    return length if length <= 8 else next(n for n in _FD_LENGTHS if n >= length)
