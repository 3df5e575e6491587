"""What is fuzzed: for each kind of file a good one, how it is mutated, and the commands that read it."""

from __future__ import annotations

import contextlib
import random
import sqlite3
import tempfile
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from fuzz_mutators import HOSTILE_VALUES, mutated_bytes, mutated_text
from support.bags import slide, write_bag

from tactile_localizer.core.scan.digest import digest_of
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scans.writer import ScanWriter
from tactile_localizer.io.scene_file import save_scene
from tactile_localizer.scene import Axis, Phalanx, Scene

SCENE = Scene(
    "sheet",
    (Axis("x", 0.0, 0.05), Axis("y", 0.0, 0.05)),
    (Phalanx("index", (0.0, 0.01)), Phalanx("middle", (0.0, -0.01))),
    measurement={"position_std": 0.003, "strain_std": 0.1, "correlation_length": 0.003},
)

COLUMNS = """
stamp_s: stamp_s * 1.0
x: x
y: y
index: index_1..8
middle: middle_1..8
sweep: sweep
strain_unit: V
"""
CONFIGURATION = """
model: sum_of_gaussians
filter: particle
particles: 50
cell: 1.0
update_distance: 0.0015
"""


@dataclass(frozen=True)
class Target:
    """One kind of file.

    Parameters
    ----------
    name : of the kind
    file : the good one, below the folder of good files
    commands : command lines, of which each case runs one. ``MUT`` stands for the mutated file, ``OUT`` for a
        new folder; other names are good files
    mutate : changes the content of ``file``
    digests : digests of the map that the file may load as; empty: whatever loads is right
    """

    name: str
    file: str
    commands: tuple[str, ...]
    mutate: Callable[[random.Random, bytes], bytes]
    digests: frozenset[str] = frozenset()


def write_good_files(folder: Path) -> tuple[Target, ...]:
    """Write a good file of each kind and tell how each is fuzzed."""
    save_scene(SCENE, folder / "scene.yaml")
    digests = _write_scan(folder / "bump_scan")
    _write_csv(ScanFolder(folder / "bump_scan").load(), folder / "train.csv")
    lines = (folder / "train.csv").read_text().splitlines()
    (folder / "test.csv").write_text("\n".join(lines[:60]) + "\n")
    (folder / "columns.yaml").write_text(COLUMNS)
    (folder / "configuration.yaml").write_text(CONFIGURATION)
    events = slide(0, 400)
    for storage, compression in (("sqlite3", "none"), ("mcap", "none"), ("mcap", "message")):
        write_bag(folder / f"{storage}_{compression}", events, storage, compression)
    return _targets(digests)


def _targets(digests: frozenset[str]) -> tuple[Target, ...]:
    import_csv = "import csv MUT --scene scene.yaml -o OUT/bump_scan"
    of_scene = (
        "import csv train.csv --scene MUT -o OUT/bump_scan",
        "replay test.csv --scan bump_scan --scene MUT",
    )
    of_columns = ("import csv test.csv --scene scene.yaml --columns MUT -o OUT/bump_scan",)
    of_configuration = ("replay test.csv --scan bump_scan --config MUT",)
    of_csv = import_csv, f"{import_csv} --force", "replay MUT --scan bump_scan"
    of_bag = (
        "import bag MUT --scene scene.yaml -o OUT/bump_scan",
        "replay MUT --scan bump_scan --material-frame material",
    )
    of_scan = (
        "scan info MUT",
        "scan info MUT --json",
        "replay test.csv --scan MUT",
    )
    return (
        Target("scene", "scene.yaml", of_scene, mutated_text),
        Target("configuration", "configuration.yaml", of_configuration, mutated_text),
        Target("columns", "columns.yaml", of_columns, mutated_text),
        Target("csv", "test.csv", of_csv, mutated_text),
        Target("sqlite bag", "sqlite3_none/sqlite3_none.db3", of_bag, _mutated_database),
        Target("mcap", "mcap_none/mcap_none.mcap", of_bag, mutated_bytes),
        Target("compressed mcap", "mcap_message/mcap_message.mcap", of_bag, mutated_bytes),
        Target("bag metadata", "mcap_none/metadata.yaml", of_bag, mutated_text),
        Target("sweep", "bump_scan/sweep_0002.npz", of_scan, mutated_bytes, digests),
        Target("recording", "bump_scan/sweep_0005.recording", of_scan, mutated_bytes),
        Target("history", "bump_scan/history.jsonl", of_scan, mutated_text, digests),
    )


def map_of(path: Path) -> str:
    """Digest of the map that the scan of a file loads as.

    Raises
    ------
    ScanError
        It is refused.
    """
    folder = ScanFolder(path.parent)
    return digest_of(folder.load(), replace(folder.scene, measurement={}))


def _write_scan(path: Path) -> frozenset[str]:
    rng = np.random.default_rng(0)
    with ScanWriter(path, SCENE) as store:
        for sweep in range(5):
            x = np.linspace(0.0, 0.05, 60)
            states = np.column_stack([x, np.full_like(x, 0.01 * sweep + 0.004)])
            strain = np.sin(150 * states @ rng.normal(size=(2, 16))) + 0.01 * rng.normal(size=(60, 16))
            store.begin_sweep()
            store.append((np.arange(60) + 100 * sweep) * 5_000_000, states, strain)
            if sweep == 4:
                recording = path / "sweep_0005.recording"
                content = recording.read_bytes()
            store.end_sweep()
        store.note("import", file="train.csv", notes=["left out 1 of 301 samples"])
    recording.write_bytes(content)
    recording.with_suffix(".npz").unlink()
    return frozenset({map_of(recording)})


def _write_csv(scan: Scan, path: Path) -> None:
    columns = np.column_stack([5e-3 * np.arange(len(scan)), scan.sweep, scan.states, scan.strain])
    names = ["stamp_s", "sweep", *scan.axes, *(f"{name}_{n}" for name in scan.phalanges for n in range(1, 9))]
    np.savetxt(path, columns, "%.17g", ",", header=",".join(names), comments="")


_UPDATES = (
    "UPDATE {table} SET {column} = {value}",
    "UPDATE {table} SET {column} = {value} WHERE rowid = 1",
    "DELETE FROM {table} WHERE rowid % 2",
    "UPDATE {table} SET {column} = substr({column}, 1, 7)",
    "UPDATE {table} SET {column} = {column} || {column}",
    "ALTER TABLE {table} RENAME COLUMN {column} TO other",
    "DROP TABLE {table}",
    "INSERT INTO {table} DEFAULT VALUES",
    "CREATE VIEW endless AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT * FROM n",
)
_VALUES = (
    "NULL",
    "-1",
    "1e300",
    "9223372036854775807",
    "'text'",
    "x''",
    "zeroblob(100)",
    "randomblob(1000)",
    "0.5",
)


def _mutated_database(rng: random.Random, content: bytes) -> bytes:
    """A SQLite file that is damaged, or in which rows are of the wrong kind."""
    if rng.random() < 0.4:
        return mutated_bytes(rng, content)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "mutated_scan")
        path.write_bytes(content)
        with closing(sqlite3.connect(path, isolation_level=None)) as connection:
            for _ in range(rng.choice((1, 1, 2))):
                with contextlib.suppress(sqlite3.Error):
                    connection.execute(_statement(rng, connection))
        return path.read_bytes()


def _statement(rng: random.Random, connection: sqlite3.Connection) -> str:
    tables = connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
    ((table,),) = rng.sample(tables, 1)
    columns = [name for _, name, *_ in connection.execute(f"PRAGMA table_info({table})")]
    text = rng.choice(HOSTILE_VALUES).replace("'", "''").replace("\0", "")
    value = rng.choice((*_VALUES, f"'{text}'"))
    return rng.choice(_UPDATES).format(table=table, column=rng.choice(columns), value=value)
