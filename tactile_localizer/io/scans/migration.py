"""Migration of scan files to the current schema version, with a backup of the original."""

from __future__ import annotations

import contextlib
import sqlite3
from pathlib import Path

from tactile_localizer.errors import ScanError
from tactile_localizer.io.scans import file as scan_file
from tactile_localizer.io.scans.reader import ScanReader
from tactile_localizer.io.scans.rows import BATCH_COLUMNS, contents_seal, header_seal, seal_of, sweep_seal
from tactile_localizer.io.whole_file import whole_file

BACKUP_SUFFIX = ".schema1"


def migrate(path: Path, connection: sqlite3.Connection) -> None:
    """Add checksums to a file of schema version 1; a file of the current version is left unchanged.

    The original is kept as ``<name>.schema1``. The migration is one transaction, so a failure or a killed
    process leaves the file unchanged.

    Parameters
    ----------
    path : the scan file
    connection : connection to it, open for writing; closed on failure

    Raises
    ------
    ScanError
        The file is damaged, or the file or its backup cannot be written.
    """
    if scan_file.schema_of(connection) > 1:
        return
    try:
        reader = ScanReader(path, connection)
        for _ in reader.checked_batches(include_dropped=True):
            pass  # refuse to add checksums to damaged data
        with (
            whole_file(f"{path}{BACKUP_SUFFIX}") as unfinished,
            contextlib.closing(sqlite3.connect(unfinished)) as backup,
        ):
            connection.backup(backup)
        _seal_all(reader, connection)
    except (*scan_file.SQLITE_ERRORS, OSError) as error:
        scan_file.close(connection)
        raise ScanError(f"{path}: could not migrate the file to the current schema: {error}") from None
    except ScanError:
        scan_file.close(connection)
        raise


def _seal_all(reader: ScanReader, connection: sqlite3.Connection) -> None:
    connection.execute("BEGIN IMMEDIATE")
    try:
        sweeps = reader.sweeps()
        for statement in scan_file.SEAL_COLUMNS:
            connection.execute(statement)
        ids = [number for (number,) in connection.execute("SELECT id FROM batch")]
        for number in ids:
            (*row, _) = connection.execute(
                f"SELECT {BATCH_COLUMNS} FROM batch WHERE id = ?", (number,)
            ).fetchone()
            connection.execute("UPDATE batch SET seal = ? WHERE id = ?", (seal_of(*row), number))
        seals = [sweep_seal(sweep) for sweep in sweeps]
        placeholders = ", ".join("?" * (len(sweeps[0].row) + 1)) if sweeps else ""
        for sweep, seal in zip(sweeps, seals, strict=True):
            connection.execute(f"INSERT OR REPLACE INTO sweep VALUES ({placeholders})", (*sweep.row, seal))
        header = dict(connection.execute("SELECT key, value FROM header").fetchall())
        entries = {"contents": contents_seal(seals), "seal": header_seal(header)}
        connection.executemany("INSERT OR REPLACE INTO header VALUES (?, ?)", entries.items())
        connection.execute(f"PRAGMA user_version = {scan_file.SCHEMA_VERSION}")
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise
