"""Messages of MCAP files by topic, a chunk at a time (https://mcap.dev/spec).

rosbags reads any bag, but spends more time on handing out a small message than it takes to localise by it.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Collection, Iterator
from operator import itemgetter
from pathlib import Path
from typing import BinaryIO
from zlib import crc32

from backports import zstd
from lz4.frame import decompress as lz4_decompress

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
STATISTICS, DATA_END = 0x0B, 0x0F

_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHANNEL_HEAD = struct.Struct("<HHI")
_CHUNK_HEAD = struct.Struct("<QQQII")

_PLAIN = {"": bytes, "zstd": zstd.decompress, "lz4": lz4_decompress}


def messages_by_topic(path: Path, topics: Collection[str]) -> dict[str, list[bytes]]:
    """The messages of some topics, each topic's in the order in which they were received.

    Parameters
    ----------
    path : a whole file; whether it is whole is for others to tell
    topics : topics without messages get an empty list

    Raises
    ------
    ValueError, struct.error, KeyError, RuntimeError, zstd.ZstdError
        Damaged chunks.
    """
    found: dict[str, list[tuple[int, bytes]]] = {topic: [] for topic in topics}
    by_channel: dict[int, list[tuple[int, bytes]]] = {}
    with path.open("rb") as file:
        file.seek(len(MAGIC))
        for code, content in records(file):
            if code == CHUNK:
                _gather(plain_chunk(content), found, by_channel)
            elif code in (CHANNEL, MESSAGE):
                _gather(_HEAD.pack(code, len(content)) + content, found, by_channel)
    received = itemgetter(0)
    return {topic: [raw for _, raw in sorted(own, key=received)] for topic, own in found.items()}


def records(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """The records of an MCAP file up to its summary; the last may be cut short, which only a chunk bears."""
    whole = os.fstat(file.fileno()).st_size  # what a damaged record claims may be far more
    while len(head := file.read(_HEAD.size)) == _HEAD.size:
        code, size = _HEAD.unpack(head)
        if code in (FOOTER, DATA_END):
            break
        content = file.read(min(size, whole))
        if len(content) == size or code == CHUNK:
            yield code, content


def chunk_parts(content: bytes) -> tuple[str, bytes]:
    """The name of a chunk's compression, and its records as they are stored."""
    *_, name_size = _CHUNK_HEAD.unpack_from(content)
    start = _CHUNK_HEAD.size
    return content[start : start + name_size].decode(), content[start + name_size + 8 :]


def plain_chunk(content: bytes) -> bytes:
    """A whole chunk's records, not compressed."""
    _, _, size, crc, _ = _CHUNK_HEAD.unpack_from(content)
    name, stored = chunk_parts(content)
    plain = _PLAIN[name](stored)
    if len(plain) != size or (crc and crc32(plain) != crc):
        raise ValueError(f"chunk: expected {size} bytes with checksum {crc:#x}, got others")
    return plain


def _gather(
    block: bytes, found: dict[str, list[tuple[int, bytes]]], by_channel: dict[int, list[tuple[int, bytes]]]
) -> None:
    """Add the messages of wanted topics, with the times at which they were received."""
    at, end = 0, len(block)
    while at < end:
        code, size = _HEAD.unpack_from(block, at)
        at += _HEAD.size
        if code == MESSAGE:
            channel, _, received_ns, _ = _MESSAGE_HEAD.unpack_from(block, at)
            if channel in by_channel:
                by_channel[channel].append((received_ns, block[at + _MESSAGE_HEAD.size : at + size]))
        elif code == CHANNEL:
            channel, _, length = _CHANNEL_HEAD.unpack_from(block, at)
            name = at + _CHANNEL_HEAD.size
            topic = block[name : name + length].decode()
            if topic in found:
                by_channel[channel] = found[topic]
        at += size
    if at != end:
        raise ValueError(f"chunk: expected whole records, the last ends {at - end} bytes late")
