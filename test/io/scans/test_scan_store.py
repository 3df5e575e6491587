"""The scan file keeps all committed pairs whatever happens to the recording process."""

import os
import resource
import signal
import sqlite3
import subprocess
import sys
import textwrap
import time
import tracemalloc
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tactile_localizer.errors import ScanError
from tactile_localizer.io.scans import file as scan_file
from tactile_localizer.io.scans import store as scan_store
from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.scene import Axis, Phalanx, Region, Scene

SCENE = Scene(
    name="bump",
    axes=(Axis("x", 0.0, 0.05), Axis("y", 0.0, 0.05)),
    phalanges=(Phalanx("index", (0.0, 0.0125)), Phalanx("middle", (0.0, -0.0125))),
    feature=Region((0.015, -np.inf), (0.045, np.inf)),
    measurement={"k": 8},
)


def pairs(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return np.arange(n) * 5_000_000, rng.uniform(0, 0.05, (n, 2)), rng.normal(size=(n, 16))


def record(path: Path, sweeps: int = 2, n: int = 10) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    recorded = [pairs(n, seed) for seed in range(sweeps)]
    with ScanStore.create(path, SCENE) as store:
        for arrays in recorded:
            store.begin_sweep()
            store.append(*arrays)
            store.end_sweep(gaps=1, skipped=2)
    return recorded


def test_pairs_are_loaded_bit_for_bit(tmp_path):
    recorded = record(tmp_path / "scan.db")
    with ScanStore.open(tmp_path / "scan.db") as store:
        scan = store.load()
        assert store.scene == SCENE
        assert store.units["strain"] == "V"
    np.testing.assert_array_equal(scan.states, np.concatenate([states for _, states, _ in recorded]))
    np.testing.assert_array_equal(scan.strain, np.concatenate([strain for _, _, strain in recorded]))
    np.testing.assert_array_equal(scan.sweep, np.repeat([1, 2], 10))
    assert (scan.axes, scan.phalanges) == (("x", "y"), ("index", "middle"))


@pytest.mark.parametrize(("at_most", "step"), [(1000, 1), (56, 1), (55, 2), (20, 3), (10, 6), (1, 56)])
def test_long_scans_are_thinned_evenly(tmp_path, at_most, step):
    stamps, states, strain = pairs(56)
    with ScanStore.create(tmp_path / "scan.db", SCENE) as store:
        for first, last in ((0, 7), (7, 8), (8, 30), (30, 33), (33, 56)):
            store.begin_sweep()
            store.append(stamps[first:last], states[first:last], strain[first:last])
            store.end_sweep()
        thinned, whole = store.load(at_most), store.load()
    assert len(thinned) <= at_most
    for name in ("states", "strain", "sweep"):
        np.testing.assert_array_equal(getattr(thinned, name), getattr(whole, name)[::step])


def test_thinning_bounds_memory(tmp_path):
    record(tmp_path / "scan.db", sweeps=20, n=5000)
    with ScanStore.open(tmp_path / "scan.db") as store:
        tracemalloc.start()
        try:
            store.load(1000)
            most = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
    assert most < 4_000_000, "all 100,000 pairs take 15 MB"


def test_batches_bound_memory(tmp_path):
    record(tmp_path / "scan.db", sweeps=20, n=5000)
    with ScanStore.open(tmp_path / "scan.db", writable=True) as store:
        store.drop_sweep(3)
        tracemalloc.start()
        try:
            shapes = [(batch.sweep, len(batch), *batch.states.shape) for batch in store.batches()]
            most = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        batches = list(store.batches())
        states, strain = (
            np.concatenate([getattr(b, name) for b in batches]) for name in ("states", "strain")
        )
        scan = store.load()
    assert shapes == [(sweep, 5000, 5000, 2) for sweep in range(1, 21) if sweep != 3]
    np.testing.assert_array_equal(states, scan.states)
    np.testing.assert_array_equal(strain, scan.strain)
    assert most < 4_000_000, "all pairs take 15 MB"


def test_loading_sees_a_snapshot(tmp_path, monkeypatch):
    path = tmp_path / "scan.db"
    record(path)
    with ScanStore.open(path, writable=True) as writer, ScanStore.open(path) as reader:
        writer.begin_sweep()

        batches = reader.batches

        def append_before():
            writer.append(*pairs(5))
            writer.commit()
            return batches()

        monkeypatch.setattr(reader, "batches", append_before)
        assert len(reader.load()) == 20
        assert len(reader.load()) == 25


def test_reading_changes_no_file(tmp_path):
    record(tmp_path / "scan.db")
    before = (tmp_path / "scan.db").read_bytes()
    with ScanStore.open(tmp_path / "scan.db") as store, ScanStore.open(tmp_path / "scan.db") as other:
        assert len(store.load()) == len(other.load()) == 20
        with pytest.raises(ScanError):
            store.begin_sweep()
    assert [file.name for file in tmp_path.iterdir()] == ["scan.db"]
    assert (tmp_path / "scan.db").read_bytes() == before


def test_recording_returns_stamps_by_sweep(tmp_path):
    recorded = record(tmp_path / "scan.db")
    with ScanStore.open(tmp_path / "scan.db") as store:
        sweeps = store.recording().sweeps
    assert [sweep.number for sweep in sweeps] == [1, 2]
    for sweep, (stamp_ns, states, strain) in zip(sweeps, recorded, strict=True):
        np.testing.assert_array_equal(sweep.stamp_ns, stamp_ns)
        np.testing.assert_array_equal(sweep.position, states)
        np.testing.assert_array_equal(sweep.strain, strain)
        assert not sweep.status.any()
        assert sweep.gaps == 1


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25)
@given(sizes=st.lists(st.integers(1, 40), min_size=1, max_size=8), commit=st.booleans())
def test_append_sizes_do_not_matter(tmp_path, sizes, commit):
    path = tmp_path / f"{time.monotonic_ns()}.db"
    stamp_ns, states, strain = pairs(sum(sizes))
    with ScanStore.create(path, SCENE) as store:
        store.begin_sweep()
        start = 0
        for size in sizes:
            part = slice(start, start + size)
            store.append(stamp_ns[part], states[part], strain[part])
            start += size
            if commit:
                store.commit()
        assert store.pairs == len(states)
    with ScanStore.open(path) as store:
        np.testing.assert_array_equal(store.load().states, states)
        np.testing.assert_array_equal(store.load().strain, strain)


def test_dropped_sweeps_can_be_restored(tmp_path):
    record(tmp_path / "scan.db", sweeps=3)
    with ScanStore.open(tmp_path / "scan.db", writable=True) as store:
        info = store.sweeps()[0]
        assert (info.number, info.pairs, info.gaps, info.skipped, info.ended) == (1, 10, 1, 2, True)
        assert (info.first_ns, info.last_ns) == (0, 45_000_000)
        store.drop_sweep(2)
        assert [sweep.dropped for sweep in store.sweeps()] == [False, True, False]
        np.testing.assert_array_equal(np.unique(store.load().sweep), [1, 3])
        store.drop_sweep(2, dropped=False)
        np.testing.assert_array_equal(np.unique(store.load().sweep), [1, 2, 3])
        assert [what for _, what, _ in store.history()] == ["drop sweep", "restore sweep"]
        with pytest.raises(ScanError, match="expected a sweep of 1 to 3, got 7"):
            store.drop_sweep(7)


def test_batches_are_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(scan_store, "_BATCH_PAIRS", 4)
    record(tmp_path / "scan.db", sweeps=1, n=10)
    sizes = sqlite3.connect(tmp_path / "scan.db").execute("SELECT pairs FROM batch").fetchall()
    assert sizes == [(4,), (4,), (2,)]


def test_pairs_are_committed_every_quarter_second(tmp_path, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(scan_store, "time", SimpleNamespace(monotonic=lambda: now[0]))
    with ScanStore.create(tmp_path / "scan.db", SCENE) as store:
        store.begin_sweep()
        reader = sqlite3.connect(tmp_path / "scan.db")
        committed = []
        for now[0] in (0.1, 0.2, 0.25, 0.3, 0.49, 0.5):
            store.append(*pairs(1))
            committed.append(reader.execute("SELECT coalesce(sum(pairs), 0) FROM batch").fetchone()[0])
        reader.close()
    assert committed == [0, 0, 3, 3, 3, 6]


KILLED = """
    import sys
    import numpy as np
    sys.path.insert(0, {root!r})
    from tactile_localizer.io.scans.store import ScanStore

    with ScanStore.open({path!r}, writable=True) as store:
        store.begin_sweep()
        written = 0
        while True:
            store.append(np.arange(5) + written, np.full((5, 2), 0.01), np.full((5, 16), float(written)))
            store.commit()
            written += 5
            print(written, flush=True)
"""


def child(code: str, **values: object) -> subprocess.Popen:
    root = str(Path(scan_store.__file__).parents[3])
    text = textwrap.dedent(code).format(root=root, **values)
    return subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE, text=True)


def test_sigkill_keeps_committed_pairs(tmp_path):
    path = tmp_path / "scan.db"
    record(path, sweeps=1)
    kept = 10
    for after_commits in (1, 7, 40):
        process = child(KILLED, path=str(path))
        try:
            committed = [int(process.stdout.readline()) for _ in range(after_commits)][-1]
        finally:
            process.send_signal(signal.SIGKILL)
            process.wait()
        with ScanStore.open(path, writable=True) as store:
            assert store.pairs >= kept + committed
            assert store.sweeps()[-1].ended is False
            kept = store.pairs
            assert len(store.load()) == kept
            assert store.begin_sweep() == store.sweeps()[-1].number
            store.append(*pairs(3))
        kept += 3
    with ScanStore.open(path) as store:
        assert len(store.load()) == kept
        assert [sweep.ended for sweep in store.sweeps()] == [True, False, True, False, True, False, True]


def fill(store: ScanStore) -> None:
    for _ in range(100):
        store.append(*pairs(500))
        store.commit()


def test_a_full_disk_keeps_committed_pairs(tmp_path):
    path = tmp_path / "scan.db"
    record(path, sweeps=1)
    store = ScanStore.open(path, writable=True)
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, limit[1]))
        store.begin_sweep()
        with pytest.raises(ScanError, match=r"scan\.db: could not write 500 pairs: "):
            fill(store)
        with pytest.raises(ScanError, match="could not write"):
            store.end_sweep()
        committed = store.pairs
        assert len(store.load()) == committed
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
        signal.signal(signal.SIGXFSZ, ignored)
    assert store.begin_sweep() == 3
    store.append(*pairs(7))
    store.close()
    with ScanStore.open(path) as store:
        assert len(store.load()) == committed + 7
        assert sqlite3.connect(path).execute("PRAGMA integrity_check").fetchone() == ("ok",)


def test_a_failed_lock_is_released(tmp_path):
    path = tmp_path / "scan.db"
    record(path, sweeps=1)
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, limit[1]))
        with pytest.raises(ScanError, match="expected a writable folder"):
            ScanStore.open(path, writable=True)
        with ScanStore.open(path) as store:
            assert len(store.load()) == 10
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
        signal.signal(signal.SIGXFSZ, ignored)
    with ScanStore.open(path, writable=True) as store:
        assert store.begin_sweep() == 2


def test_a_second_writer_is_refused(tmp_path):
    path = tmp_path / "scan.db"
    record(path)
    with ScanStore.open(path, writable=True) as first:
        first.begin_sweep()
        with pytest.raises(ScanError, match=f"expected no other writer, process {os.getpid()}") as refusal:
            ScanStore.open(path, writable=True)
        assert "\n" not in str(refusal.value)
        (tmp_path / "alias.db").symlink_to(path)
        with pytest.raises(ScanError, match="expected no other writer"):
            ScanStore.open(tmp_path / "alias.db", writable=True)
        with ScanStore.open(path) as reader:
            assert len(reader.load()) == 20
            with pytest.raises(ScanError, match="opened for writing"):
                reader.drop_sweep(1)
    with ScanStore.open(path, writable=True) as second:
        assert second.begin_sweep() == 4
    assert list(tmp_path.glob("*.lock")) == []


def foreign_text(path: Path) -> None:
    path.write_text("x, y\n1, 2\n" * 100)


def foreign_database(path: Path) -> None:
    execute(path, "CREATE TABLE song (title TEXT)")


def execute(path: Path, *statements: str) -> None:
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        for statement in statements:
            connection.execute(statement)


def changed(*statements: str) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        record(path)
        execute(path, *statements)

    return make


newer_scan = changed("PRAGMA user_version = 99")
header_without_scene = changed("DELETE FROM header WHERE key = 'scene'")
header_of_something_else = changed("UPDATE header SET value = '{}' WHERE key = 'scene'")
header_that_is_cut_off = changed("UPDATE header SET value = substr(value, 1, 20)")


def descriptors_of(path: Path) -> list[str]:
    opened = []
    for link in Path("/proc/self/fd").iterdir():
        with suppress(FileNotFoundError):  # other threads close theirs meanwhile
            opened.append(str(link.readlink()))
    return [name for name in opened if name.startswith(str(path))]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: None, "expected a scan file, found none"),
        (lambda path: path.touch(), "expected a scan file, found an empty file"),
        (lambda path: path.mkdir(), "expected a scan file, found a directory"),
        (foreign_text, "expected a scan file, file is not a database"),
        (foreign_database, "found a database of another program"),
        (newer_scan, "expected a scan file of schema version 1 to 2, found 99"),
        (header_without_scene, "could not read its header"),
        (header_of_something_else, "could not read its header: the checksum does not match"),
        (header_that_is_cut_off, "could not read its header"),
    ],
)
def test_other_files_are_refused_and_closed(tmp_path, make, message):
    path = tmp_path / "scan.db"
    make(path)
    for writable in (False, True):
        with pytest.raises(ScanError, match=message) as refusal:
            ScanStore.open(path, writable=writable)
        assert str(refusal.value).startswith(str(path))
        assert "\n" not in str(refusal.value)
        assert descriptors_of(path) == []


@pytest.mark.parametrize("writable", [False, True])
def test_a_busy_file_is_refused(tmp_path, monkeypatch, writable):
    monkeypatch.setattr(scan_file, "BUSY_TIMEOUT_S", 0.0)
    path = tmp_path / "scan.db"
    changed("PRAGMA journal_mode = DELETE")(path)
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN EXCLUSIVE")
        with pytest.raises(ScanError, match=r"scan\.db: expected a scan file, database is locked"):
            ScanStore.open(path, writable=writable)
    with ScanStore.open(path, writable=writable) as store:
        assert len(store.load()) == 20


def test_a_damaged_file_reports_readable_pairs(tmp_path):
    path = tmp_path / "scan.db"
    record(path, sweeps=1, n=5000)
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size // 2)
    with pytest.raises(ScanError, match=r"scan\.db"):
        ScanStore.open(path).load()


def test_an_empty_scan_is_refused(tmp_path):
    path = tmp_path / "scan.db"
    ScanStore.create(path, SCENE).close()
    with ScanStore.open(path) as store, pytest.raises(ScanError, match="expected at least one"):
        store.load()


def test_create_does_not_overwrite(tmp_path):
    record(tmp_path / "scan.db")
    with pytest.raises(ScanError, match="expected no file of this name"):
        ScanStore.create(tmp_path / "scan.db", SCENE)


def test_recording_continues_for_the_same_scene_only(tmp_path):
    path = tmp_path / "scan.db"
    with ScanStore.open_or_create(path, SCENE) as store:
        store.begin_sweep()
        store.append(*pairs(3))
    with ScanStore.open_or_create(path, SCENE) as store:
        assert store.begin_sweep() == 2
    other = Scene("bump", SCENE.axes, (Phalanx("index", (0.0, 0.0)),))
    with pytest.raises(ScanError, match="expected phalanges index, found index, middle"):
        ScanStore.open_or_create(path, other)
    ScanStore.open(path, writable=True).close()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t, x, z: (t, x, z[:, :8]), r"expected shapes .* got \(3, 2\) and \(3, 8\)"),
        (lambda t, x, z: (t, x[:, :1], z), "expected shapes"),
        (lambda t, x, z: (t, x * np.nan, z), "expected finite values"),
        (lambda t, x, z: (t, x, z * np.inf), "expected finite values"),
    ],
)
def test_pairs_of_wrong_shape_are_refused(tmp_path, change, message):
    with ScanStore.create(tmp_path / "scan.db", SCENE) as store:
        store.begin_sweep()
        with pytest.raises(ScanError, match=message):
            store.append(*change(*pairs(3)))


def test_pairs_need_an_active_sweep(tmp_path):
    with ScanStore.create(tmp_path / "scan.db", SCENE) as store:
        with pytest.raises(ScanError, match="expected an active sweep"):
            store.append(*pairs(1))
        store.begin_sweep(5)
        with pytest.raises(ScanError, match="expected no active sweep, found sweep 5"):
            store.begin_sweep()
        store.end_sweep()
        assert store.begin_sweep(5) == 6


def test_a_scan_is_readable_in_a_read_only_folder(tmp_path):
    folder = tmp_path / "archive"
    folder.mkdir()
    record(folder / "scan.db")
    folder.chmod(0o555)
    (folder / "scan.db").chmod(0o444)
    try:
        with ScanStore.open(folder / "scan.db") as store:
            assert len(store.load()) == 20
        if os.getuid() != 0:
            with pytest.raises(ScanError, match="expected a writable folder"):
                ScanStore.open(folder / "scan.db", writable=True)
    finally:
        folder.chmod(0o755)
