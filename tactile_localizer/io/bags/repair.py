"""Repair of damaged bag files: rewrites the readable part of a file into one that rosbags reads.

A killed recorder leaves an MCAP file without its summary, or an SQLite file with a write-ahead log or
missing pages; an interrupted copy leaves a truncated compressed file.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

from backports import zstd
from lz4.frame import LZ4FrameDecompressor

from tactile_localizer.errors import ScanError

_MAGIC = b"\x89MCAP0\r\n"
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _MESSAGE_INDEX, _CHUNK_INDEX = range(1, 9)
_STATISTICS, _DATA_END = 0x0B, 0x0F
"""Opcodes of MCAP records (https://mcap.dev/spec)."""

_RECORD_HEAD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQII")

_PARTIAL: dict[str, Callable[[bytes], bytes]] = {
    "": bytes,
    "zstd": lambda data: zstd.ZstdDecompressor().decompress(data),
    "lz4": lambda data: LZ4FrameDecompressor().decompress(data),
}
"""Decompresses as much of a chunk as there is, by the name of its compression."""

_BLOCK_BYTES = 1 << 20
"""Bytes read and written at once."""


def repair(path: Path, folder: Path) -> Path:
    """Write the readable part of a bag file to a new file in ``folder``, and return its path.

    Parameters
    ----------
    path : ``*.mcap`` or ``*.db3``, followed by ``.zstd`` or ``.zst`` if compressed
    folder : folder for the new file and temporary files

    Raises
    ------
    ScanError
        Nothing in the file can be read.
    """
    if path.suffix in (".zstd", ".zst"):
        plain = folder / path.stem
        _decompress(path, plain)
        path = plain
    target = folder / f"repaired_{path.name}"
    try:
        if path.suffix == ".mcap":
            _repair_mcap(path, target)
        else:
            _repair_sqlite(path, target, folder)
    except (OSError, sqlite3.Error, struct.error) as error:
        raise ScanError(f"{path}: expected a bag file, {error}") from None
    return target


def _decompress(path: Path, plain: Path) -> None:
    """Decompress up to the end, the damage, or the point of truncation."""
    frame = zstd.ZstdDecompressor()
    with path.open("rb") as file, plain.open("wb") as out, contextlib.suppress(zstd.ZstdError):
        while block := file.read(_BLOCK_BYTES):
            while block:
                if frame.eof:
                    frame = zstd.ZstdDecompressor()
                out.write(frame.decompress(block))
                block = frame.unused_data


def _repair_sqlite(path: Path, target: Path, folder: Path) -> None:
    copy = folder / f"copy_{path.name}"
    for suffix in ("", "-wal"):
        with contextlib.suppress(FileNotFoundError):
            shutil.copyfile(f"{path}{suffix}", f"{copy}{suffix}")
    with (
        contextlib.closing(sqlite3.connect(copy)) as source,
        contextlib.closing(sqlite3.connect(target)) as out,
    ):
        # Without writable_schema SQLite refuses files that are shorter than their header says.
        source.execute("PRAGMA writable_schema = ON")
        tables = source.execute(
            "SELECT name, sql FROM sqlite_master WHERE type = 'table' AND sql IS NOT NULL"
        )
        # Messages last: damage is most likely there, and the other tables are needed to read them.
        for name, sql in sorted(tables.fetchall(), key=lambda table: table[0] == "messages"):
            out.execute(sql)
            with contextlib.suppress(sqlite3.Error):
                for row in source.execute(f"SELECT * FROM {name} NOT INDEXED"):
                    out.execute(f"INSERT INTO {name} VALUES ({', '.join('?' * len(row))})", row)
        out.commit()


def _repair_mcap(path: Path, target: Path) -> None:
    """Write the complete records into new indexed chunks, followed by the summary that rosbags requires."""
    with path.open("rb") as file, target.open("wb") as out:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise ScanError(f"{path}: expected an MCAP file, found another kind of file")
        out.write(_MAGIC)
        chunk_indices = []
        loose = bytearray()
        for code, content in _records(file):
            if code == _HEADER:
                _write(out, code, content)
            elif code in (_SCHEMA, _CHANNEL, _MESSAGE):
                loose += struct.pack("<BQ", code, len(content)) + content
            elif code == _CHUNK:
                chunk_indices.append(_write_chunk(out, _partial_chunk(content)))
            if len(loose) > _BLOCK_BYTES:
                chunk_indices.append(_write_chunk(out, bytes(loose)))
                loose.clear()
        chunk_indices.append(_write_chunk(out, bytes(loose)))
        _write(out, _DATA_END, bytes(4))
        summary = out.tell()
        # With empty statistics rosbags counts the messages itself.
        _write(out, _STATISTICS, struct.pack("<QHIIIIQQI", 0, 0, 0, 0, 0, len(chunk_indices), 0, 0, 0))
        for index in chunk_indices:
            _write(out, _CHUNK_INDEX, index)
        _write(out, _FOOTER, struct.pack("<QQI", summary, 0, 0))
        out.write(_MAGIC)


def _records(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Records of an MCAP file up to its summary; a truncated chunk at the end is included."""
    file_bytes = os.fstat(file.fileno()).st_size  # a damaged record may claim to be far larger
    while len(head := file.read(_RECORD_HEAD.size)) == _RECORD_HEAD.size:
        code, size = _RECORD_HEAD.unpack(head)
        if code in (_FOOTER, _DATA_END):
            break
        content = file.read(min(size, file_bytes))
        if len(content) == size or code == _CHUNK:
            yield code, content


def _chunk_parts(content: bytes) -> tuple[str, bytes]:
    """Name of a chunk's compression, and its compressed records."""
    *_, name_size = _CHUNK_HEAD.unpack_from(content)
    start = _CHUNK_HEAD.size
    return content[start : start + name_size].decode(), content[start + name_size + 8 :]


def _partial_chunk(content: bytes) -> bytes:
    """Decompressed records of a chunk that may be truncated; empty if it cannot be decompressed."""
    try:
        name, stored = _chunk_parts(content)
        return _PARTIAL[name](stored)
    except (struct.error, UnicodeDecodeError, KeyError, zstd.ZstdError, RuntimeError):
        return b""


def _write_chunk(out: BinaryIO, plain: bytes) -> bytes:
    """Write the complete records of ``plain`` as a chunk with message indices; return its chunk index."""
    end = 0
    messages: dict[int, list[tuple[int, int]]] = {}
    while end + 9 <= len(plain):
        code, size = struct.unpack_from("<BQ", plain, end)
        if end + 9 + size > len(plain):
            break
        if code == _MESSAGE:
            channel, _, log_time = struct.unpack_from("<HIQ", plain, end + 9)
            messages.setdefault(channel, []).append((log_time, end))
        end += 9 + size
    times = [log_time for entries in messages.values() for log_time, _ in entries] or [0]
    span = struct.pack("<QQ", min(times), max(times))
    start = out.tell()
    _write(out, _CHUNK, span + struct.pack("<QIIQ", end, 0, 0, end) + plain[:end])
    indices_start = out.tell()
    offsets = b""
    for channel, entries in messages.items():
        offsets += struct.pack("<HQ", channel, out.tell())
        flat = b"".join(struct.pack("<QQ", *entry) for entry in entries)
        _write(out, _MESSAGE_INDEX, struct.pack("<HI", channel, len(flat)) + flat)
    head = span + struct.pack("<QQI", start, indices_start - start, len(offsets)) + offsets
    return head + struct.pack("<QIQQ", out.tell() - indices_start, 0, end, end)


def _write(out: BinaryIO, code: int, content: bytes) -> None:
    out.write(struct.pack("<BQ", code, len(content)) + content)
