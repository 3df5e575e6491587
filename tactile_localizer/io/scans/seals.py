"""Checksums ("seals") of the rows of a scan file, which detect damage and identify undamaged rows.

Every row that the map depends on has a seal: 16 bytes of BLAKE2b over its other columns. The contents
seal in the header covers the seals of all sweeps, and the entry of a sweep holds the number of its
batches. A row that was changed, lost, duplicated or moved is therefore detected.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping

from tactile_localizer.io.scans.sweep_info import SweepInfo

SEAL_BYTES = 16

Column = int | str | bytes


def seal_of(*columns: Column) -> bytes:
    """Seal of a row, from its columns in order."""
    digest = hashlib.blake2b(digest_size=SEAL_BYTES)
    for column in columns:
        if isinstance(column, bytes):
            digest.update(b"b%d:" % len(column))
            digest.update(column)
        else:
            digest.update(f"{type(column).__name__}{column!r}:".encode())
    return digest.digest()


def header_seal(header: Mapping[str, str]) -> str:
    """Seal of the header's entries (text by key), excluding the seals among them."""
    entries = sorted((key, value) for key, value in header.items() if key not in ("seal", "contents"))
    return seal_of(*(text for entry in entries for text in entry)).hex()


def contents_seal(sweep_seals: Iterable[bytes]) -> str:
    """Seal of all sweeps, from their seals in the order of their numbers."""
    return seal_of("contents", *sweep_seals).hex()


def sweep_seal(sweep: SweepInfo) -> bytes:
    """Seal of a sweep's entry."""
    return seal_of("sweep", *sweep.row)
