"""The SQLite file that holds a scan: its tables, and opening it so that foreign files are refused.

Pairs lie in batches, one batch a transaction: arrays as little-endian blobs, so that a million pairs
load in well under a second and appending costs one row every quarter of a second.
"""

from __future__ import annotations

import contextlib
import json
import sqlite3
from pathlib import Path
from typing import Any

from tactile_localizer.errors import ScanError
from tactile_localizer.io.scene_file import scene_to_dict
from tactile_localizer.scene import Scene

APPLICATION_ID = 0x54_4C_53_43
"""``TLSC``: marks a SQLite file as a scan (SQLite's ``application_id``)."""

SCHEMA_VERSION = 1
"""Version of the tables below (SQLite's ``user_version``)."""

_TABLES = """
CREATE TABLE header (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE sweep (
    number INTEGER PRIMARY KEY,
    ended INTEGER NOT NULL DEFAULT 0,     -- 0 after a crash: the recording was cut off
    gaps INTEGER NOT NULL DEFAULT 0,      -- strain samples without a pose near enough
    skipped INTEGER NOT NULL DEFAULT 0,   -- strain samples missing, saturated or out of bounds
    dropped INTEGER NOT NULL DEFAULT 0    -- left out by a person; can be taken back
);
CREATE TABLE batch (
    id INTEGER PRIMARY KEY,
    sweep INTEGER NOT NULL REFERENCES sweep (number),
    pairs INTEGER NOT NULL,
    first_ns INTEGER NOT NULL,
    last_ns INTEGER NOT NULL,
    stamp_ns BLOB NOT NULL,               -- int64 (pairs,)
    states BLOB NOT NULL,                 -- float64 (pairs, axes): m, rad
    strain BLOB NOT NULL                  -- float64 (pairs, 8 x phalanges)
);
CREATE INDEX batch_sweep ON batch (sweep);
CREATE TABLE history (id INTEGER PRIMARY KEY, at TEXT NOT NULL, what TEXT NOT NULL, detail TEXT NOT NULL);
"""


def create(path: Path, scene: Scene, strain_unit: str) -> sqlite3.Connection:
    """Make an empty scan file and open it for writing.

    Raises
    ------
    ScanError
        A file of that name exists, or it cannot be written.
    """
    if _has_content(path):
        raise ScanError(f"{path}: expected no file of this name yet, found one")
    header = {
        "scene": json.dumps(scene_to_dict(scene)),
        "axes": json.dumps(scene.axis_names),
        "phalanges": json.dumps(scene.phalanx_names),
        "units": json.dumps({"stamp": "ns", "state": "m, yaw: rad", "strain": strain_unit}),
    }
    try:
        connection = _connect(f"{path.absolute().as_uri()}?mode=rwc")
        connection.execute("BEGIN IMMEDIATE")
        for statement in _TABLES.split(";\n"):
            connection.execute(statement)
        connection.executemany("INSERT INTO header VALUES (?, ?)", header.items())
        connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
        connection.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
        connection.execute("COMMIT")
        _prepare_for_writing(connection)
    except sqlite3.Error as error:
        raise ScanError(f"{path}: expected a place for a new scan file, {error}") from None
    return connection


def open_existing(path: Path, *, writable: bool) -> sqlite3.Connection:
    """Open a scan file.

    Raises
    ------
    ScanError
        There is no such file, it is not a scan, or it was made by a newer version.
    """
    if not _has_content(path):
        raise ScanError(f"{path}: expected a scan file, found {'an empty file' if path.exists() else 'none'}")
    try:
        connection = _open(path, writable)
        found_id = connection.execute("PRAGMA application_id").fetchone()[0]
        version = connection.execute("PRAGMA user_version").fetchone()[0]
    except sqlite3.DatabaseError as error:
        raise ScanError(f"{path}: expected a scan file, {error}") from None
    if found_id != APPLICATION_ID:
        connection.close()
        raise ScanError(f"{path}: expected a scan file, found a database of another program")
    if version != SCHEMA_VERSION:
        connection.close()
        raise ScanError(f"{path}: expected a scan file of schema version {SCHEMA_VERSION}, found {version}")
    if writable:
        _prepare_for_writing(connection)
    return connection


def read_header(connection: sqlite3.Connection) -> dict[str, Any]:
    """The scan file's header: scene, axes, phalanges and units, decoded."""
    rows = connection.execute("SELECT key, value FROM header").fetchall()
    return {key: json.loads(value) for key, value in rows}


def _has_content(path: Path) -> bool:
    # A creation that was killed before its first commit leaves an empty file, which may be written over.
    return path.exists() and (path.is_dir() or path.stat().st_size > 0)


def _connect(uri: str) -> sqlite3.Connection:
    # Transactions are begun by hand; the executor's threads take turns with one connection.
    return sqlite3.connect(uri, uri=True, isolation_level=None, check_same_thread=False, timeout=5.0)


def _open(path: Path, writable: bool) -> sqlite3.Connection:
    uri = path.absolute().as_uri()
    # For reading too: a connection that may only read leaves its log behind when it is the last to close.
    connection = _connect(f"{uri}?mode=rw")
    if writable:
        return connection
    try:
        connection.execute("PRAGMA query_only = ON")
        connection.execute("SELECT count(*) FROM sqlite_master")
    except sqlite3.OperationalError:
        # Sharing a write-ahead log needs a folder that can be written; without a log nothing is shared.
        log = Path(f"{path}-wal")
        if log.exists() and log.stat().st_size:
            raise
        connection = _connect(f"{uri}?immutable=1")
    return connection


def _prepare_for_writing(connection: sqlite3.Connection) -> None:
    connection.execute("PRAGMA journal_mode = WAL")
    # FULL: a commit is on the disk when it returns, so that power loss costs no more than kill -9.
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute("PRAGMA foreign_keys = ON")


def close(connection: sqlite3.Connection) -> None:
    """Close the connection; what a full disk does not let it tidy up, it tidies up at the next opening."""
    with contextlib.suppress(sqlite3.Error):
        connection.close()
