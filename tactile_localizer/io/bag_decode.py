"""Strain and pose messages straight from their bytes (CDR): only what recordings need of them.

A bag of ten minutes holds a quarter of a million, and making message objects of them takes most of the time
of reading it. Only little-endian messages of the definitions that come with this package are decoded here.
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

import numpy as np

_LITTLE_ENDIAN = b"\x00\x01"
_BODY = 4
"""Bytes before the body, from whose start alignment counts."""

_STAMP = struct.Struct("<iI")
_COUNT = struct.Struct("<I")
_POSE = struct.Struct("<7d")
_NANOSECONDS = 1_000_000_000


class Strain(NamedTuple):
    """What a ``StrainVectors`` message holds, but for its frame and counters."""

    stamp_ns: int
    phalanges: tuple[str, ...]
    values: np.ndarray
    status: np.ndarray


class Pose(NamedTuple):
    """What a ``PoseStamped`` message holds: translation in m, quaternion as x, y, z, w."""

    stamp_ns: int
    frame: str
    translation: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]


def strain_of(message: Any) -> Strain:
    """From a message object."""
    return Strain(stamp_of(message), tuple(message.phalanges), message.strain, message.status)


def pose_of(message: Any) -> Pose:
    """From a message object."""
    place, turn = message.pose.position, message.pose.orientation
    return Pose(
        stamp_of(message),
        message.header.frame_id,
        (place.x, place.y, place.z),
        (turn.x, turn.y, turn.z, turn.w),
    )


def strain_from_bytes(raw: bytes) -> Strain:
    """From the message's bytes.

    Raises
    ------
    ValueError, struct.error
        The bytes end too early, or are big-endian.
    """
    stamp_ns, _, at = _header(raw)
    count, at = _count(raw, at)
    names = []
    for _ in range(count):
        name, at = _text(raw, at)
        names.append(name)
    count, at = _count(raw, at)
    at = _aligned(at, 8) if count else at
    values = np.frombuffer(raw, "<f8", count, at)
    count, at = _count(raw, at + 8 * len(values))
    return Strain(stamp_ns, tuple(names), values, np.frombuffer(raw, np.uint8, count, at))


def pose_from_bytes(raw: bytes) -> Pose:
    """From the message's bytes, as :func:`strain_from_bytes`."""
    stamp_ns, frame, at = _header(raw)
    numbers = _POSE.unpack_from(raw, _aligned(at, 8))
    return Pose(stamp_ns, frame, numbers[:3], numbers[3:])


def stamp_of(message: Any) -> int:
    """The header's stamp of a message object, ns."""
    stamp = message.header.stamp
    return int(stamp.sec) * _NANOSECONDS + int(stamp.nanosec)


def _header(raw: bytes) -> tuple[int, str, int]:
    if raw[:2] != _LITTLE_ENDIAN:
        raise ValueError(f"CDR: expected little-endian bytes, got {bytes(raw[:2])!r}")
    seconds, nanoseconds = _STAMP.unpack_from(raw, _BODY)
    frame, at = _text(raw, _BODY + _STAMP.size)
    return seconds * _NANOSECONDS + nanoseconds, frame, at


def _text(raw: bytes, at: int) -> tuple[str, int]:
    count, at = _count(raw, at)
    return str(raw[at : at + max(count - 1, 0)], "utf-8"), at + count


def _count(raw: bytes, at: int) -> tuple[int, int]:
    at = _aligned(at, 4)
    return _COUNT.unpack_from(raw, at)[0], at + 4


def _aligned(at: int, size: int) -> int:
    return at + -(at - _BODY) % size
