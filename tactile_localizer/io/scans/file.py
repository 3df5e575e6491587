"""SQLite file of a scan: its tables, and opening it with a check that it is a scan.

Pairs are stored in batches, one batch per transaction, as little-endian arrays in blobs. A million pairs
load in well under a second, and appending costs one row every quarter of a second.
"""

from __future__ import annotations

import contextlib
import json
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tactile_localizer.errors import ScanError
from tactile_localizer.io.scans.rows import contents_seal, header_seal
from tactile_localizer.io.scene_file import scene_to_dict
from tactile_localizer.scene import Scene

APPLICATION_ID = 0x54_4C_53_43
"""Marks an SQLite file as a scan (SQLite's ``application_id``): ``TLSC`` in ASCII."""

SCHEMA_VERSION = 2
"""Version of the tables below (SQLite's ``user_version``); version 1 has no checksums."""

PAGE_SIZE = 4096
"""Bytes per page of the file: SQLite's default. Repair relies on it."""

BUSY_TIMEOUT_S = 5.0
"""Longest wait for another program that has locked the file, s; Python's default for SQLite."""

SQLITE_ERRORS = (sqlite3.Error, UnicodeDecodeError, MemoryError)
"""Exceptions of Python's sqlite3 for damaged files, whose names and texts need not be valid UTF-8."""

REPAIR_HINT = "`tactile-localizer scan repair` keeps the undamaged pairs"

_MAX_REASON_CHARACTERS = 120

_TABLES = """
CREATE TABLE header (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE sweep (
    number INTEGER PRIMARY KEY,
    ended INTEGER NOT NULL DEFAULT 0,     -- 0 if the recording was interrupted
    gaps INTEGER NOT NULL DEFAULT 0,      -- strain samples without a pose close enough in time
    skipped INTEGER NOT NULL DEFAULT 0,   -- strain samples missing, saturated or out of bounds
    dropped INTEGER NOT NULL DEFAULT 0,   -- excluded by the user; can be restored
    batches INTEGER NOT NULL DEFAULT 0,
    pairs INTEGER NOT NULL DEFAULT 0,
    first_ns INTEGER NOT NULL DEFAULT 0,
    last_ns INTEGER NOT NULL DEFAULT 0,
    revision INTEGER NOT NULL DEFAULT 0,  -- number of changes of this row
    seal BLOB NOT NULL DEFAULT x''        -- checksum of the other columns
);
CREATE TABLE batch (
    id INTEGER PRIMARY KEY,
    sweep INTEGER NOT NULL REFERENCES sweep (number),
    pairs INTEGER NOT NULL,
    first_ns INTEGER NOT NULL,
    last_ns INTEGER NOT NULL,
    stamp_ns BLOB NOT NULL,               -- int64 (pairs,)
    states BLOB NOT NULL,                 -- float64 (pairs, axes): m, rad
    strain BLOB NOT NULL,                 -- float64 (pairs, channels of all phalanges)
    seal BLOB NOT NULL DEFAULT x''        -- checksum of the other columns
);
CREATE TABLE history (id INTEGER PRIMARY KEY, at TEXT NOT NULL, what TEXT NOT NULL, detail TEXT NOT NULL);
"""

LEARNED_TABLE = """
CREATE TABLE IF NOT EXISTS learned (
    key TEXT PRIMARY KEY,                 -- name of the result, its algorithm and version
    digest TEXT NOT NULL,                 -- of the scan and the scene that it was computed from
    payload BLOB NOT NULL,
    seal BLOB NOT NULL                    -- checksum of the other columns
)
"""
"""Table of cached results computed from the scan; files of any schema version may have it."""


def create(path: Path, scene: Scene, strain_unit: str) -> sqlite3.Connection:
    """Create an empty scan file and open it for writing.

    Raises
    ------
    ScanError
        A file of that name exists, or it cannot be written.
    """
    if _has_content(path):
        raise ScanError(f"{path}: expected no file of this name, found one")
    header = {
        "scene": json.dumps(scene_to_dict(scene)),
        "axes": json.dumps(scene.axis_names),
        "phalanges": json.dumps(scene.phalanx_names),
        "units": json.dumps({"stamp": "ns", "state": "m, yaw: rad", "strain": strain_unit}),
        "contents": contents_seal([]),
    }
    header["seal"] = header_seal(header)
    try:
        with _connected(f"{path.absolute().as_uri()}?mode=rwc") as connection:
            connection.execute(f"PRAGMA page_size = {PAGE_SIZE}")
            connection.execute("BEGIN IMMEDIATE")
            for statement in _TABLES.split(";\n"):
                connection.execute(statement)
            connection.execute(LEARNED_TABLE)
            connection.executemany("INSERT INTO header VALUES (?, ?)", header.items())
            connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
            connection.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
            connection.execute("COMMIT")
            _prepare_for_writing(connection)
            return connection
    except SQLITE_ERRORS as error:
        raise ScanError(f"{path}: expected a path where a scan file can be created, {error}") from None


def open_existing(path: Path, *, writable: bool) -> sqlite3.Connection:
    """Open a scan file.

    Raises
    ------
    ScanError
        There is no such file, it is not a scan, or it was written by a newer version.
    """
    if not _has_content(path):
        raise ScanError(f"{path}: expected a scan file, found {'an empty file' if path.exists() else 'none'}")
    if path.is_dir():
        raise ScanError(f"{path}: expected a scan file, found a directory")
    uri = path.absolute().as_uri()
    try:
        # Read-write even for reading: a read-only connection leaves the write-ahead log behind on closing.
        with _connected(f"{uri}?mode=rw") as connection:
            _require_scan(connection, path)
            connection.execute(f"PRAGMA query_only = {int(not writable)}")
            if writable:
                _prepare_for_writing(connection)
            return connection
    except SQLITE_ERRORS as error:
        if not writable and _can_open_immutable(path, error):
            return _open_immutable(path, uri)
        raise ScanError(f"{path}: expected a scan file, {reason(error)}") from None


def schema_of(connection: sqlite3.Connection) -> int:
    """Schema version of the file."""
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    return int(version)


def read_header(connection: sqlite3.Connection) -> dict[str, Any]:
    """Decoded header of the scan file: scene, axes, phalanges and units.

    Raises
    ------
    ValueError
        The header's checksum does not match, or an entry is not JSON.
    """
    rows: dict[str, str] = dict(connection.execute("SELECT key, value FROM header").fetchall())
    if schema_of(connection) > 1 and rows.pop("seal", None) != header_seal(rows):
        raise ValueError(f"the checksum does not match; {REPAIR_HINT}")
    rows.pop("contents", None)
    return {key: json.loads(value) for key, value in rows.items()}


def one_line(error: Exception) -> str:
    """The message of an SQLite error in one line, cut to a reasonable length."""
    if isinstance(error, UnicodeDecodeError | MemoryError):
        return "database disk image is malformed"
    return " ".join(str(error).split())[:_MAX_REASON_CHARACTERS]


def reason(error: Exception) -> str:
    """The message of an SQLite error in one line, with a hint at ``scan repair`` for damaged files."""
    text = one_line(error)
    return f"{text}; {REPAIR_HINT}" if "malformed" in text else text


def _has_content(path: Path) -> bool:
    # A process killed before its first commit leaves an empty file, which may be overwritten.
    try:
        return path.exists() and (path.is_dir() or path.stat().st_size > 0)
    except OSError as error:
        raise ScanError(f"{str(path)[:80]}: expected the path of a scan file, {error.strerror}") from None


@contextlib.contextmanager
def _connected(uri: str) -> Iterator[sqlite3.Connection]:
    """A connection that is closed if the block raises, and stays open otherwise."""
    # Transactions are explicit; the executor's threads use one connection in turn.
    connection = sqlite3.connect(
        uri, uri=True, isolation_level=None, check_same_thread=False, timeout=BUSY_TIMEOUT_S
    )
    try:
        yield connection
    except BaseException:
        connection.close()
        raise


def _require_scan(connection: sqlite3.Connection, path: Path) -> None:
    (found_id,) = connection.execute("PRAGMA application_id").fetchone()
    version = schema_of(connection)
    if found_id != APPLICATION_ID:
        raise ScanError(f"{path}: expected a scan file, found a database of another program")
    if version not in (1, SCHEMA_VERSION):
        raise ScanError(
            f"{path}: expected a scan file of schema version 1 to {SCHEMA_VERSION}, found {version}"
        )
    kinds = {kind for (kind,) in connection.execute("SELECT type FROM sqlite_master")}
    if others := kinds - {"table", "index"}:  # a malicious view could run forever
        raise ScanError(f"{path}: expected tables and indices only, found {min(map(ascii, others))}")
    columns = {name for _, name, *_ in connection.execute("PRAGMA table_info(sweep)")}
    if ("seal" in columns) != (version > 1):
        raise ScanError(f"{path}: schema version {version} does not match its tables; {REPAIR_HINT}")


def _can_open_immutable(path: Path, error: Exception) -> bool:
    """Whether opening failed only because the folder is read-only, and there is no write-ahead log."""
    log = Path(f"{path}-wal")
    is_denied = isinstance(error, sqlite3.OperationalError) and "locked" not in str(error)
    return is_denied and not (log.exists() and log.stat().st_size)


def _open_immutable(path: Path, uri: str) -> sqlite3.Connection:
    try:
        with _connected(f"{uri}?immutable=1") as connection:
            _require_scan(connection, path)
            return connection
    except SQLITE_ERRORS as error:
        raise ScanError(f"{path}: expected a scan file, {reason(error)}") from None


def _prepare_for_writing(connection: sqlite3.Connection) -> None:
    connection.execute("PRAGMA journal_mode = WAL")
    # FULL: a commit is on disk when it returns, so power loss costs no more than SIGKILL.
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute("PRAGMA foreign_keys = ON")


def close(connection: sqlite3.Connection) -> None:
    """Close the connection; cleanup that fails on a full disk is done at the next opening."""
    with contextlib.suppress(*SQLITE_ERRORS):
        connection.close()
