"""Whole copies of damaged bag files: what was written before a recorder was cut off.

A recorder that dies leaves an MCAP file without its summary, or a SQLite file with a write-ahead log or
missing pages; a copy that was cut short is compressed data without an end. Each is rewritten up to the
damage into a file that rosbags reads.
"""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from backports import zstd
from lz4.frame import LZ4FrameDecompressor

from tactile_localizer.errors import ScanError
from tactile_localizer.io.bags import mcap

_PARTIAL: dict[str, Callable[[bytes], bytes]] = {
    "": bytes,
    "zstd": lambda data: zstd.ZstdDecompressor().decompress(data),
    "lz4": lambda data: LZ4FrameDecompressor().decompress(data),
}
"""How much of a compressed chunk there is, by the name of its compression."""

_BLOCK = 1 << 20


def repair(path: Path, folder: Path) -> Path:
    """Rewrite what is whole in a bag file to a file in ``folder``.

    Parameters
    ----------
    path : ``*.mcap`` or ``*.db3``, with ``.zstd`` or ``.zst`` behind it where it is compressed
    folder : for the copy and what is needed on the way

    Raises
    ------
    ScanError
        Nothing of the file can be read.
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
    """Decompress to the end, to the damage, or to where the file was cut short."""
    frame = zstd.ZstdDecompressor()
    with path.open("rb") as file, plain.open("wb") as out, contextlib.suppress(zstd.ZstdError):
        while block := file.read(_BLOCK):
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
        # A file shorter than its header says is refused unless its schema may be written.
        source.execute("PRAGMA writable_schema = ON")
        tables = source.execute(
            "SELECT name, sql FROM sqlite_master WHERE type = 'table' AND sql IS NOT NULL"
        )
        # Messages last: they are what is damaged.
        for name, sql in sorted(tables.fetchall(), key=lambda table: table[0] == "messages"):
            out.execute(sql)
            with contextlib.suppress(sqlite3.Error):
                for row in source.execute(f"SELECT * FROM {name} NOT INDEXED"):
                    out.execute(f"INSERT INTO {name} VALUES ({', '.join('?' * len(row))})", row)
        out.commit()


def _repair_mcap(path: Path, target: Path) -> None:
    """Write whole records into chunks with indices of their own, and the summary that rosbags looks for."""
    with path.open("rb") as file, target.open("wb") as out:
        if file.read(len(mcap.MAGIC)) != mcap.MAGIC:
            raise ScanError(f"{path}: expected an MCAP file, found another kind of file")
        out.write(mcap.MAGIC)
        chunk_indices = []
        loose = bytearray()
        for code, content in mcap.records(file):
            if code == mcap.HEADER:
                _write(out, code, content)
            elif code in (mcap.SCHEMA, mcap.CHANNEL, mcap.MESSAGE):
                loose += struct.pack("<BQ", code, len(content)) + content
            elif code == mcap.CHUNK:
                chunk_indices.append(_write_chunk(out, _partial_chunk(content)))
            if len(loose) > _BLOCK:
                chunk_indices.append(_write_chunk(out, bytes(loose)))
                loose.clear()
        chunk_indices.append(_write_chunk(out, bytes(loose)))
        _write(out, mcap.DATA_END, bytes(4))
        summary = out.tell()
        # Empty statistics let rosbags count for itself.
        _write(out, mcap.STATISTICS, struct.pack("<QHIIIIQQI", 0, 0, 0, 0, 0, len(chunk_indices), 0, 0, 0))
        for index in chunk_indices:
            _write(out, mcap.CHUNK_INDEX, index)
        _write(out, mcap.FOOTER, struct.pack("<QQI", summary, 0, 0))
        out.write(mcap.MAGIC)


def _partial_chunk(content: bytes) -> bytes:
    """As much as there is of what a chunk holds, not compressed; nothing where that cannot be told."""
    try:
        name, stored = mcap.chunk_parts(content)
        return _PARTIAL[name](stored)
    except (struct.error, UnicodeDecodeError, KeyError, zstd.ZstdError, RuntimeError):
        return b""


def _write_chunk(out: BinaryIO, plain: bytes) -> bytes:
    """Write the whole records of ``plain`` as a chunk with its message indices; returns its chunk index."""
    end = 0
    messages: dict[int, list[tuple[int, int]]] = {}
    while end + 9 <= len(plain):
        code, size = struct.unpack_from("<BQ", plain, end)
        if end + 9 + size > len(plain):
            break
        if code == mcap.MESSAGE:
            channel, _, log_time = struct.unpack_from("<HIQ", plain, end + 9)
            messages.setdefault(channel, []).append((log_time, end))
        end += 9 + size
    times = [log_time for entries in messages.values() for log_time, _ in entries] or [0]
    span = struct.pack("<QQ", min(times), max(times))
    start = out.tell()
    _write(out, mcap.CHUNK, span + struct.pack("<QIIQ", end, 0, 0, end) + plain[:end])
    indices_start = out.tell()
    offsets = b""
    for channel, entries in messages.items():
        offsets += struct.pack("<HQ", channel, out.tell())
        flat = b"".join(struct.pack("<QQ", *entry) for entry in entries)
        _write(out, mcap.MESSAGE_INDEX, struct.pack("<HI", channel, len(flat)) + flat)
    head = span + struct.pack("<QQI", start, indices_start - start, len(offsets)) + offsets
    return head + struct.pack("<QIQQ", out.tell() - indices_start, 0, end, end)


def _write(out: BinaryIO, code: int, content: bytes) -> None:
    out.write(struct.pack("<BQ", code, len(content)) + content)
