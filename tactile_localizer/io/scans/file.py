"""The SQLite file that holds a scan: its tables, and opening it so that foreign files are refused.

Pairs lie in batches, one batch a transaction: arrays as little-endian blobs, so that a million pairs
load in well under a second and appending costs one row every quarter of a second.
"""

from __future__ import annotations

import contextlib
import json
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tactile_localizer.errors import ScanError
from tactile_localizer.io.scans.seals import contents_seal, header_seal
from tactile_localizer.io.scene_file import scene_to_dict
from tactile_localizer.scene import Scene

APPLICATION_ID = 0x54_4C_53_43
"""``TLSC``: marks a SQLite file as a scan (SQLite's ``application_id``)."""

SCHEMA_VERSION = 2
"""Version of the tables below (SQLite's ``user_version``); version 1 has no seals."""

PAGE_SIZE = 4096
"""Bytes of a page of the file: SQLite's default, which repairing relies on."""

PATIENCE_S = 5.0
"""How long another program's hold on the file is waited for, s."""

SQLITE_ERRORS = (sqlite3.Error, UnicodeDecodeError, MemoryError)
"""What Python's sqlite3 raises on a damaged file: names and messages in it need not be text."""

REPAIR_HINT = "`tactile-localizer scan repair` keeps what is whole"

_LONGEST_REASON = 120

_TABLES = """
CREATE TABLE header (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE sweep (
    number INTEGER PRIMARY KEY,
    ended INTEGER NOT NULL DEFAULT 0,     -- 0 after a crash: the recording was cut off
    gaps INTEGER NOT NULL DEFAULT 0,      -- strain samples without a pose near enough
    skipped INTEGER NOT NULL DEFAULT 0,   -- strain samples missing, saturated or out of bounds
    dropped INTEGER NOT NULL DEFAULT 0,   -- left out by a person; can be taken back
    batches INTEGER NOT NULL DEFAULT 0,
    pairs INTEGER NOT NULL DEFAULT 0,
    first_ns INTEGER NOT NULL DEFAULT 0,
    last_ns INTEGER NOT NULL DEFAULT 0,
    revision INTEGER NOT NULL DEFAULT 0,  -- counts the changes of this row
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
    key TEXT PRIMARY KEY,                 -- what was learned, by which algorithm and version
    digest TEXT NOT NULL,                 -- of the scan and the scene that it was learned from
    payload BLOB NOT NULL,
    seal BLOB NOT NULL                    -- checksum of the other columns
)
"""
"""Table of results learned from the scan; files of any schema version may have it."""

SEAL_COLUMNS = (
    "ALTER TABLE sweep ADD COLUMN batches INTEGER NOT NULL DEFAULT 0",
    "ALTER TABLE sweep ADD COLUMN pairs INTEGER NOT NULL DEFAULT 0",
    "ALTER TABLE sweep ADD COLUMN first_ns INTEGER NOT NULL DEFAULT 0",
    "ALTER TABLE sweep ADD COLUMN last_ns INTEGER NOT NULL DEFAULT 0",
    "ALTER TABLE sweep ADD COLUMN revision INTEGER NOT NULL DEFAULT 0",
    "ALTER TABLE sweep ADD COLUMN seal BLOB NOT NULL DEFAULT x''",
    "ALTER TABLE batch ADD COLUMN seal BLOB NOT NULL DEFAULT x''",
    "DROP INDEX batch_sweep",
)
"""What turns the tables of version 1 into those of version 2."""


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
        raise ScanError(f"{path}: expected a place for a new scan file, {error}") from None


def open_existing(path: Path, *, writable: bool) -> sqlite3.Connection:
    """Open a scan file.

    Raises
    ------
    ScanError
        There is no such file, it is not a scan, or it was made by a newer version.
    """
    if not _has_content(path):
        raise ScanError(f"{path}: expected a scan file, found {'an empty file' if path.exists() else 'none'}")
    if path.is_dir():
        raise ScanError(f"{path}: expected a scan file, found a directory")
    uri = path.absolute().as_uri()
    try:
        # For reading too: a connection that may only read leaves its log behind when it is the last to close.
        with _connected(f"{uri}?mode=rw") as connection:
            _require_scan(connection, path)
            connection.execute(f"PRAGMA query_only = {int(not writable)}")
            if writable:
                _prepare_for_writing(connection)
            return connection
    except SQLITE_ERRORS as error:
        if not writable and _is_alone(path, error):
            return _open_alone(path, uri)
        raise ScanError(f"{path}: expected a scan file, {reason(error)}") from None


def schema_of(connection: sqlite3.Connection) -> int:
    """Version of the file's tables."""
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    return int(version)


def read_header(connection: sqlite3.Connection) -> dict[str, Any]:
    """The scan file's header: scene, axes, phalanges and units, decoded.

    Raises
    ------
    ValueError
        The header does not fit its seal, or is not JSON.
    """
    rows: dict[str, str] = dict(connection.execute("SELECT key, value FROM header").fetchall())
    if schema_of(connection) > 1 and rows.pop("seal", None) != header_seal(rows):
        raise ValueError(f"the checksum does not fit; {REPAIR_HINT}")
    rows.pop("contents", None)
    return {key: json.loads(value) for key, value in rows.items()}


def in_words(error: Exception) -> str:
    """What sqlite3 says, in one line; it may quote what is in the file."""
    if isinstance(error, UnicodeDecodeError | MemoryError):
        return "database disk image is malformed"
    return " ".join(str(error).split())[:_LONGEST_REASON]


def reason(error: Exception) -> str:
    """The same, with the way out where the file is damaged."""
    text = in_words(error)
    return f"{text}; {REPAIR_HINT}" if "malformed" in text else text


def _has_content(path: Path) -> bool:
    # A creation that was killed before its first commit leaves an empty file, which may be written over.
    try:
        return path.exists() and (path.is_dir() or path.stat().st_size > 0)
    except OSError as error:
        raise ScanError(f"{str(path)[:80]}: expected the path of a scan file, {error.strerror}") from None


@contextlib.contextmanager
def _connected(uri: str) -> Iterator[sqlite3.Connection]:
    """A connection that stays open when the block ends well, and is closed when it fails."""
    # Transactions are begun by hand; the executor's threads take turns with one connection.
    connection = sqlite3.connect(
        uri, uri=True, isolation_level=None, check_same_thread=False, timeout=PATIENCE_S
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
    if strange := kinds - {"table", "index"}:  # a view could compute for ever
        raise ScanError(f"{path}: expected tables and indices only, found {min(map(ascii, strange))}")
    columns = {name for _, name, *_ in connection.execute("PRAGMA table_info(sweep)")}
    if ("seal" in columns) != (version > 1):
        raise ScanError(f"{path}: its schema version {version} does not fit its tables; {REPAIR_HINT}")


def _is_alone(path: Path, error: Exception) -> bool:
    """Whether only sharing a log failed, for which the folder must be writable, and there is no log."""
    log = Path(f"{path}-wal")
    is_refused = isinstance(error, sqlite3.OperationalError) and "locked" not in str(error)
    return is_refused and not (log.exists() and log.stat().st_size)


def _open_alone(path: Path, uri: str) -> sqlite3.Connection:
    try:
        with _connected(f"{uri}?immutable=1") as connection:
            _require_scan(connection, path)
            return connection
    except SQLITE_ERRORS as error:
        raise ScanError(f"{path}: expected a scan file, {reason(error)}") from None


def _prepare_for_writing(connection: sqlite3.Connection) -> None:
    connection.execute("PRAGMA journal_mode = WAL")
    # FULL: a commit is on the disk when it returns, so that power loss costs no more than kill -9.
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute("PRAGMA foreign_keys = ON")


def close(connection: sqlite3.Connection) -> None:
    """Close the connection; what a full disk does not let it tidy up, it tidies up at the next opening."""
    with contextlib.suppress(*SQLITE_ERRORS):
        connection.close()
