"""Scan files of schema version 1, without checksums."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

_TO_VERSION_1 = """
CREATE TABLE old_sweep (number INTEGER PRIMARY KEY, ended INTEGER NOT NULL DEFAULT 0,
    gaps INTEGER NOT NULL DEFAULT 0, skipped INTEGER NOT NULL DEFAULT 0, dropped INTEGER NOT NULL DEFAULT 0);
CREATE TABLE old_batch (id INTEGER PRIMARY KEY, sweep INTEGER NOT NULL REFERENCES sweep (number),
    pairs INTEGER NOT NULL, first_ns INTEGER NOT NULL, last_ns INTEGER NOT NULL,
    stamp_ns BLOB NOT NULL, states BLOB NOT NULL, strain BLOB NOT NULL);
INSERT INTO old_sweep SELECT number, ended, gaps, skipped, dropped FROM sweep;
INSERT INTO old_batch SELECT id, sweep, pairs, first_ns, last_ns, stamp_ns, states, strain FROM batch;
DROP TABLE batch;
DROP TABLE sweep;
DROP TABLE learned;
ALTER TABLE old_sweep RENAME TO sweep;
ALTER TABLE old_batch RENAME TO batch;
CREATE INDEX batch_sweep ON batch (sweep);
DELETE FROM header WHERE key IN ('seal', 'contents');
PRAGMA user_version = 1;
"""


def make_old(path: Path) -> None:
    """Turn a scan file of the present schema into one of version 1, with the same content."""
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript(_TO_VERSION_1)
        connection.execute("VACUUM")
