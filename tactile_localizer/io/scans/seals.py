"""Checksums of the rows of a scan file: damage is found wherever it strikes, and undamaged rows are known.

Every row that the map depends on carries a seal: 16 bytes of BLAKE2b over its other columns. The seal of
the contents, in the header, covers the seals of all sweeps; an entry of a sweep holds the number of its
batches. So a row that is changed, lost, doubled or moved is noticed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping

from tactile_localizer.io.scans.sweep_info import SweepInfo

SEAL_BYTES = 16

Column = int | str | bytes


def seal_of(*columns: Column) -> bytes:
    """Seal of a row, given its columns in order."""
    digest = hashlib.blake2b(digest_size=SEAL_BYTES)
    for column in columns:
        if isinstance(column, bytes):
            digest.update(b"b%d:" % len(column))
            digest.update(column)
        else:
            digest.update(f"{type(column).__name__}{column!r}:".encode())
    return digest.digest()


def header_seal(header: Mapping[str, str]) -> str:
    """Seal of the header's entries, given as texts by key; the seals among them are left out."""
    entries = sorted((key, value) for key, value in header.items() if key not in ("seal", "contents"))
    return seal_of(*(text for entry in entries for text in entry)).hex()


def contents_seal(sweep_seals: Iterable[bytes]) -> str:
    """Seal of all sweeps, given theirs in the order of their numbers."""
    return seal_of("contents", *sweep_seals).hex()


def sweep_seal(sweep: SweepInfo) -> bytes:
    """Seal of a sweep's entry."""
    return seal_of("sweep", *sweep.row)
