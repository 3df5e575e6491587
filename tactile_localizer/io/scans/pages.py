"""Rows of a damaged SQLite file, read from its pages without the tree that leads to them.

SQLite reads a table from its root page down, so that one damaged page hides all rows below it. Here every
page is looked at by itself: the rows of a table's leaf pages are decoded wherever they lie (the file format
is described at https://www.sqlite.org/fileformat2.html). Rows may be damaged, stale, or of any table; only
the caller can know which are good.
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
_LOG_MAGIC = (0x377F0682, 0x377F0683)
_INTEGERS = {1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8}
"""Bytes of the integers of a record, by serial type."""

Place = tuple[int, int]
"""Number of a page and offset of a row in it."""

Row = tuple[int, tuple[Any, ...]]
"""A row's id and its columns; a column that is the id itself is ``None``."""


class Pages:
    """The pages of a SQLite file, those in its write-ahead log in place of the older ones.

    Use it as a context.

    Parameters
    ----------
    path : the database file; a log beside it is read as well

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
        """The rows of all leaf pages of tables, as far as they can be decoded, and where they are."""
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
        """The row at a place that :meth:`rows` gave.

        Raises
        ------
        ValueError, IndexError
            It cannot be decoded.
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
        """The newest page of each number in the log. Its checksums are not needed: rows have seals."""
        if not path.exists():
            return {}
        log = self._mapped(path)
        if len(log) < 32 or int.from_bytes(log[:4], "big") not in _LOG_MAGIC:
            return {}
        pages = {}
        for start in range(32, len(log) - PAGE_SIZE - 24 + 1, PAGE_SIZE + 24):
            if log[start + 8 : start + 16] != log[16:24]:
                break  # left over from before the log began anew
            pages[int.from_bytes(log[start : start + 4], "big")] = log[start + 24 : start + 24 + PAGE_SIZE]
        return pages

    def _payload(self, page: bytes, offset: int, length: int) -> bytes:
        """A row's bytes: the first in the page, the others in a chain of overflow pages."""
        if length > len(self._file) + len(self._logged) * PAGE_SIZE:
            raise ValueError("longer than the file")
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
                raise ValueError("cut off")
            parts.append(page[4 : 4 + min(missing, PAGE_SIZE - 4)])
            missing -= PAGE_SIZE - 4
            following = int.from_bytes(page[:4], "big")
        return b"".join(parts)


def _varint(data: bytes, offset: int) -> tuple[int, int]:
    """SQLite's variable-length integer at ``offset``, and where it ends."""
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
    """One column, and where the next begins."""
    if kind == 0:
        return None, start
    if kind in (8, 9):
        return kind - 8, start
    size = _INTEGERS.get(kind, 8 if kind == 7 else (kind - 12) // 2)
    data = record[start : start + size]
    if size < 0 or len(data) < size:
        raise ValueError("cut off")
    if kind in _INTEGERS:
        return int.from_bytes(data, "big", signed=True), start + size
    if kind == 7:
        return struct.unpack(">d", data)[0], start + size
    return (data.decode() if kind % 2 else data), start + size
