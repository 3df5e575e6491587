"""Damage of scan files is detected and reported, and repair keeps the undamaged rows."""

import random
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from support import scans
from support.old_scans import make_old

from tactile_localizer.core.scan.digest import digest_of
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ScanError
from tactile_localizer.io.scans.repair import repair
from tactile_localizer.io.scans.store import ScanStore

SCENE = scans.scene()
SWEEPS, COMMITS, PAIRS = 6, 4, 12


def record(path: Path, sweeps: int = SWEEPS) -> None:
    """Sweeps of several batches each, as a recorder commits them; the second is dropped."""
    rng = np.random.default_rng(1)
    with ScanStore.create(path, SCENE) as store:
        for sweep in range(sweeps):
            store.begin_sweep()
            for commit in range(COMMITS):
                states = rng.uniform(0.0, scans.SIDE, (PAIRS, 2))
                stamps = (np.arange(PAIRS) + PAIRS * (commit + COMMITS * sweep)) * 5_000_000
                store.append(stamps, states, scans.strain_at(states))
                store.commit()
            store.end_sweep(gaps=sweep, skipped=2 * sweep)
        store.drop_sweep(2)


@pytest.fixture
def path(tmp_path):
    record(tmp_path / "scan.db")
    return tmp_path / "scan.db"


def loaded(path: Path) -> Scan:
    with ScanStore.open(path) as store:
        return store.load()


def execute(path: Path, *statements: str) -> None:
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        for statement in statements:
            connection.execute(statement)


def pairs_of(scan: Scan) -> set[bytes]:
    return {row.tobytes() for row in np.column_stack([scan.states, scan.strain])}


def test_no_flipped_byte_changes_the_map(path, tmp_path):
    whole, digest = path.read_bytes(), digest_of(loaded(path), SCENE)
    rng, flipped, messages, refused = random.Random(2), tmp_path / "flipped.db", set(), 0
    for position in rng.sample(range(len(whole)), 400):
        damaged = bytearray(whole)
        damaged[position] ^= rng.randrange(1, 256)
        flipped.write_bytes(damaged)
        try:
            scan = loaded(flipped)
        except ScanError as error:
            refused += 1
            messages.add(str(error))
        else:
            assert digest_of(scan, SCENE) == digest, f"byte {position}"
    assert refused > 100, "most of the file is pairs"
    assert not any("\n" in message for message in messages)


def test_swapped_pages_are_detected(path, tmp_path):
    whole, digest = path.read_bytes(), digest_of(loaded(path), SCENE)
    pages = [whole[start : start + 4096] for start in range(0, len(whole), 4096)]
    rng, exchanged, refused = random.Random(4), tmp_path / "exchanged.db", 0
    for _ in range(100):
        one, other = rng.sample(range(len(pages)), 2)
        changed = list(pages)
        changed[one], changed[other] = pages[other], pages[one]
        exchanged.write_bytes(b"".join(changed))
        try:
            assert digest_of(loaded(exchanged), SCENE) == digest
        except ScanError:
            refused += 1
    assert refused > 80


def test_repair_invents_no_pairs(path, tmp_path):
    whole, recorded = path.read_bytes(), pairs_of(loaded(path))
    rng, kept = random.Random(3), []
    for trial, position in enumerate(rng.sample(range(len(whole)), 60)):
        damaged = tmp_path / f"{trial}.db"
        content = bytearray(whole)
        content[position] ^= rng.randrange(1, 256)
        damaged.write_bytes(content)
        report = repair(damaged, SCENE)
        found = pairs_of(loaded(damaged))
        assert report.pairs >= 0.6 * SWEEPS * COMMITS * PAIRS
        if not any("dropped" in note for note in report.notes):  # else sweep 2 is back
            assert found <= recorded
        kept.append(len(found) / len(recorded))
    assert np.mean(kept) > 0.9


def test_the_damaged_sweep_is_named(path):
    execute(path, "UPDATE batch SET strain = zeroblob(length(strain)) WHERE sweep = 4 AND id % 4 = 1")
    message = (
        r"sweep 4 damaged, 1 of 4 batches cannot be read \(the checksum does not match\); `.* scan repair`"
    )
    with pytest.raises(ScanError, match=r"scan\.db: " + message):
        loaded(path)
    with ScanStore.open(path, writable=True) as store:
        store.drop_sweep(4)
        assert set(store.load().sweep) == {1, 3, 5, 6}
        assert len(store.recording().sweeps) == 4


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("DELETE FROM batch WHERE id = 9", "sweep 3 damaged, 1 of 4 batches"),
        ("DELETE FROM batch WHERE sweep = 3", "sweep 3 damaged, 4 of 4 batches"),
        ("UPDATE batch SET sweep = 5 WHERE id = 9", "sweep 3 damaged, 1 of 4 batches"),
        ("UPDATE batch SET sweep = 2 WHERE id = 9", "sweep 3 damaged, 1 of 4 batches"),
        ("UPDATE batch SET sweep = 77 WHERE id = 9", "sweep 3 damaged, 1 of 4 batches"),
        ("UPDATE batch SET id = 99 WHERE id = 9", "sweep 3 damaged, 1 of 4 batches"),
        ("UPDATE batch SET strain = 'text' WHERE id = 9", "sweep 3 damaged, 1 of 4 batches"),
        ("UPDATE batch SET pairs = 1e300 WHERE id = 9", "sweep 3 damaged, 1 of 4 batches"),
        ("UPDATE sweep SET dropped = 0", "the entry of sweep 2 is damaged"),
        ("UPDATE sweep SET gaps = 'many' WHERE number = 3", "the entry of sweep 3 is damaged"),
        ("DELETE FROM sweep WHERE number = 3", "an entry of a sweep is lost, found 5"),
        ("UPDATE header SET value = '{}' WHERE key = 'units'", "the checksum does not match"),
        ("DELETE FROM header WHERE key = 'contents'", "an entry of a sweep is lost"),
        ("PRAGMA user_version = 1", "schema version 1 does not match its tables"),
        (
            "CREATE VIEW endless AS SELECT 1",
            "expected tables and indices only, found 'view'",
        ),
    ],
)
def test_modified_rows_are_detected(path, statement, message):
    execute(path, "PRAGMA foreign_keys = OFF", statement)
    with pytest.raises(ScanError, match=message):
        loaded(path)


def test_repair_keeps_undamaged_rows(path):
    before = loaded(path)
    execute(path, "UPDATE batch SET states = zeroblob(length(states)) WHERE id = 14")
    damaged = path.read_bytes()
    report = repair(path)
    assert report.notes == ("sweep 4: lost 1 of 4 batches",)
    assert (report.sweeps, report.pairs) == (SWEEPS, (SWEEPS * COMMITS - 1) * PAIRS)
    assert report.damaged.read_bytes() == damaged
    with ScanStore.open(path) as store:
        lost = slice(2 * COMMITS * PAIRS + PAIRS, 2 * COMMITS * PAIRS + 2 * PAIRS)
        np.testing.assert_array_equal(store.load().states, np.delete(before.states, lost, axis=0))
        assert [info.dropped for info in store.sweeps()] == [number == 2 for number in range(1, 7)]
        assert [info.gaps for info in store.sweeps()] == list(range(6))
        _, what, detail = store.history()[0]
        assert (what, detail["notes"]) == ("repair", list(report.notes))
        assert detail["history"][0][1] == "drop sweep"
    assert not list(path.parent.glob("*.lock"))


def test_repair_leaves_an_undamaged_file_unchanged(path):
    before = path.read_bytes()
    report = repair(path)
    assert (report.damaged, report.pairs, report.sweeps) == (None, SWEEPS * COMMITS * PAIRS, SWEEPS)
    assert path.read_bytes() == before


@pytest.mark.parametrize("old", [False, True])
@pytest.mark.parametrize("fraction", [0.4, 0.7, 0.95])
def test_repair_keeps_batches_of_a_truncated_file(tmp_path, old, fraction):
    path = tmp_path / "long.db"
    record(path, sweeps=30)
    if old:
        make_old(path)
    recorded = pairs_of(loaded(path))
    with path.open("r+b") as file:
        file.truncate(int(fraction * path.stat().st_size))
    with pytest.raises(ScanError, match="scan repair"):
        loaded(path)
    report = repair(path, SCENE)
    assert report.pairs > (fraction - 0.2) * 30 * COMMITS * PAIRS
    with ScanStore.open(path, writable=True) as store:
        store.drop_sweep(2)
        assert pairs_of(store.load()) <= recorded


def test_a_file_without_header_needs_a_scene(path):
    execute(path, "UPDATE header SET value = 'lost'")
    with pytest.raises(ScanError, match=r"expected an undamaged header, found none; give .*--scene"):
        repair(path)
    assert repair(path, SCENE).pairs == SWEEPS * COMMITS * PAIRS
    assert len(loaded(path)) == (SWEEPS - 1) * COMMITS * PAIRS


def test_repair_refuses_a_file_without_pairs(path, tmp_path):
    (tmp_path / "text.db").write_text("x, y\n" * 5000)
    for scene in (None, SCENE):
        with pytest.raises(ScanError, match=r"text\.db: expected"):
            repair(tmp_path / "text.db", scene)
    with pytest.raises(ScanError, match="expected a scan file, found none"):
        repair(tmp_path / "none.db")
    assert not list(tmp_path.glob("*.damaged"))


def test_repair_reads_the_write_ahead_log(path):
    log = Path(f"{path}-wal")
    with closing(sqlite3.connect(path)) as held:
        held.execute("SELECT count(*) FROM sweep").fetchone()  # keeps the log
        with ScanStore.open(path, writable=True) as store:
            store.begin_sweep()
            store.append(np.arange(3), np.full((3, 2), 0.01), np.full((3, 16), 0.5))
        content, logged = path.read_bytes(), log.read_bytes()
    path.write_bytes(content[:5000] + b"\xff" * 200 + content[5200:])
    log.write_bytes(logged)
    report = repair(path, SCENE)
    assert 7 in loaded(path).sweep
    assert report.pairs >= 3


def test_schema_1_is_read_and_migrated_on_writing(path):
    before = digest_of(loaded(path), SCENE)
    with ScanStore.open(path) as store:
        sweeps = store.sweeps()
    make_old(path)
    old = path.read_bytes()
    with ScanStore.open(path) as store:
        assert not store.has_checksums
        assert digest_of(store.load(), store.scene) == before
    assert path.read_bytes() == old
    with ScanStore.open(path, writable=True) as store:
        assert store.has_checksums
        assert store.begin_sweep() == 7
    assert digest_of(loaded(path), SCENE) == before
    with ScanStore.open(path) as store:
        assert [
            (s.number, s.pairs, s.first_ns, s.last_ns, s.gaps, s.dropped) for s in store.sweeps()[:6]
        ] == [(s.number, s.pairs, s.first_ns, s.last_ns, s.gaps, s.dropped) for s in sweeps]
    assert digest_of(loaded(path.with_name("scan.db.schema1")), SCENE) == before
    execute(path, "UPDATE batch SET strain = zeroblob(length(strain)) WHERE id = 1")
    with pytest.raises(ScanError, match="sweep 1 damaged"):
        loaded(path)


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("UPDATE batch SET sweep = 77 WHERE id = 9", "expected a batch of a known sweep, found sweep 77"),
        ("UPDATE batch SET strain = 'text' WHERE id = 9", "expected arrays of 12 pairs"),
        ("UPDATE batch SET pairs = 4000000000 WHERE id = 9", "the file is too small"),
        ("UPDATE batch SET pairs = 1e300 WHERE id = 9", "the entry of sweep 3 is damaged"),
        ("UPDATE sweep SET dropped = 'no'", "the entry of sweep 1 is damaged"),
    ],
)
def test_damaged_schema_1_is_not_migrated(path, statement, message):
    make_old(path)
    execute(path, "PRAGMA foreign_keys = OFF", statement)
    with pytest.raises(ScanError, match=message):
        loaded(path)
    with pytest.raises(ScanError):
        ScanStore.open(path, writable=True)
    assert not list(path.parent.glob("*.schema1"))


def test_failed_migration_leaves_the_file_unchanged(path):
    make_old(path)
    path.with_name("scan.db.schema1").mkdir()
    before = path.read_bytes()
    with pytest.raises(ScanError, match="expected no file of this name"):
        ScanStore.open(path, writable=True)
    assert path.read_bytes() == before
    assert len(loaded(path)) == 5 * COMMITS * PAIRS


@pytest.mark.parametrize(("states", "strain"), [(2e3, 0.1), (0.01, 1e300), (0.01, -2e10), (-np.inf, 0.1)])
def test_implausible_values_are_refused(path, states, strain):
    with ScanStore.open(path, writable=True) as store:
        store.begin_sweep()
        with pytest.raises(ScanError, match=r"(position|strain): expected finite values of at most 1"):
            store.append(np.arange(1), np.full((1, 2), states), np.full((1, 16), strain))
    make_old(path)
    values = np.full((PAIRS, 2), states).tobytes(), np.full((PAIRS, 16), strain).tobytes()
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("UPDATE batch SET states = ?, strain = ? WHERE id = 1", values)
    with pytest.raises(ScanError, match=r"(position|strain): expected finite values of at most 1"):
        loaded(path)
