"""Rows of a damaged SQLite file, read page by page without the B-tree.

SQLite reads a table from its root page down, so one damaged page hides all rows below it. Here the rows of
every leaf page are decoded independently (file format: https://www.sqlite.org/fileformat2.html). They may
be damaged, stale, or belong to any table; the caller has to validate them.
"""

from __future__ import annotations

import contextlib
import mmap
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tactile_localizer.io.scans.file import PAGE_SIZE

_TABLE_LEAF = 13
"""Type of a leaf page of a table, the first byte of its header."""

_LOG_MAGIC = (0x377F0682, 0x377F0683)
"""First four bytes of a write-ahead log with little-endian and with big-endian checksums."""

_INTEGER_BYTES = {1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8}
"""Size of an integer in a record, by serial type."""

Place = tuple[int, int]
"""Page number, and offset of a row in the page."""

Row = tuple[int, tuple[Any, ...]]
"""Row id and columns; ``None`` stands for the column that is the row id."""


class Pages:
    """Pages of an SQLite file, with newer versions from its write-ahead log; a context manager.

    Parameters
    ----------
    path : the database file; a write-ahead log beside it is read as well

    Raises
    ------
    OSError
        The file cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._stack = contextlib.ExitStack()
        self._file = self._mapped(path)
        self._logged = self._pages_of_log(Path(f"{path}-wal"))

    def __enter__(self) -> Pages:
        return self

    def __exit__(self, *_: object) -> None:
        self._logged.clear()
        self._stack.close()

    def rows(self) -> Iterator[tuple[Place, Row]]:
        """Location and content of every row of a table's leaf page that can be decoded."""
        last = max(len(self._file) // PAGE_SIZE, *self._logged, 0)
        for number in range(1, last + 1):
            page = self._page(number)
            start = 100 if number == 1 else 0
            if len(page) < PAGE_SIZE or page[start] != _TABLE_LEAF:
                continue
            first = start + 8
            count = min(int.from_bytes(page[start + 3 : start + 5], "big"), (PAGE_SIZE - first) // 2)
            for (offset,) in struct.iter_unpack(">H", page[first : first + 2 * count]):
                with contextlib.suppress(ValueError, IndexError):
                    yield (number, offset), self.row((number, offset))

    def row(self, place: Place) -> Row:
        """The row at a location from :meth:`rows`.

        Raises
        ------
        ValueError, IndexError
            The row cannot be decoded.
        """
        number, offset = place
        page = self._page(number)
        length, offset = _varint(page, offset)
        key, offset = _varint(page, offset)
        return key - (2**64 if key >= 2**63 else 0), _columns(self._payload(page, offset, length))

    def _mapped(self, path: Path) -> bytes | mmap.mmap:
        if path.stat().st_size == 0:
            return b""
        file = self._stack.enter_context(path.open("rb"))
        return self._stack.enter_context(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))

    def _page(self, number: int) -> bytes:
        if number in self._logged:
            return self._logged[number]
        return self._file[(number - 1) * PAGE_SIZE : number * PAGE_SIZE]

    def _pages_of_log(self, path: Path) -> dict[int, bytes]:
        """Newest version of each page in the log. Its checksums are ignored because rows have seals."""
        if not path.exists():
            return {}
        log = self._mapped(path)
        if len(log) < 32 or int.from_bytes(log[:4], "big") not in _LOG_MAGIC:
            return {}
        pages = {}
        for start in range(32, len(log) - PAGE_SIZE - 24 + 1, PAGE_SIZE + 24):
            if log[start + 8 : start + 16] != log[16:24]:
                break  # salt of an earlier log: the rest was written before the last checkpoint
            pages[int.from_bytes(log[start : start + 4], "big")] = log[start + 24 : start + 24 + PAGE_SIZE]
        return pages

    def _payload(self, page: bytes, offset: int, length: int) -> bytes:
        """Bytes of a row: the first are in the page, the rest in a chain of overflow pages."""
        if length > len(self._file) + len(self._logged) * PAGE_SIZE:
            raise ValueError("row longer than the file")
        local = length
        if length > PAGE_SIZE - 35:
            least = (PAGE_SIZE - 12) * 32 // 255 - 23
            local = least + (length - least) % (PAGE_SIZE - 4)
            local = local if local <= PAGE_SIZE - 35 else least
        parts = [page[offset : offset + local]]
        missing = length - local
        following = int.from_bytes(page[offset + local : offset + local + 4], "big")
        while missing > 0:
            page = self._page(following) if following else b""
            if len(page) < PAGE_SIZE:
                raise ValueError("row is truncated")
            parts.append(page[4 : 4 + min(missing, PAGE_SIZE - 4)])
            missing -= PAGE_SIZE - 4
            following = int.from_bytes(page[:4], "big")
        return b"".join(parts)


def _varint(data: bytes, offset: int) -> tuple[int, int]:
    """SQLite's variable-length integer at ``offset``, and the offset after it."""
    value = 0
    for index in range(8):
        byte = data[offset + index]
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, offset + index + 1
    return value << 8 | data[offset + 8], offset + 9


def _columns(record: bytes) -> tuple[Any, ...]:
    end, offset = _varint(record, 0)
    kinds = []
    while offset < end:
        kind, offset = _varint(record, offset)
        kinds.append(kind)
    columns = []
    for kind in kinds:
        value, end = _value(record, end, kind)
        columns.append(value)
    return tuple(columns)


def _value(record: bytes, start: int, kind: int) -> tuple[Any, int]:
    """A column, and the offset of the next one."""
    if kind == 0:
        return None, start
    if kind in (8, 9):
        return kind - 8, start
    size = _INTEGER_BYTES.get(kind, 8 if kind == 7 else (kind - 12) // 2)
    data = record[start : start + size]
    if size < 0 or len(data) < size:
        raise ValueError("column is truncated")
    if kind in _INTEGER_BYTES:
        return int.from_bytes(data, "big", signed=True), start + size
    if kind == 7:
        return struct.unpack(">d", data)[0], start + size
    return (data.decode() if kind % 2 else data), start + size
