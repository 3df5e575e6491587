"""Cached results are reused for the same data only, and storing them never fails."""

import logging
import sqlite3
import threading
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from support import scans

from tactile_localizer.core.scan.digest import digest_of
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.io.scans import lock as scan_lock
from tactile_localizer.io.scans.learned import load_learned, store_learned
from tactile_localizer.io.scans.rows import LearnedEntry
from tactile_localizer.io.scans.store import ScanStore

SCENE = scans.scene()
PAYLOAD = bytes(range(256)) * 8


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "scan.db"
    states = np.random.default_rng(0).uniform(0.0, scans.SIDE, (20, 2))
    with ScanStore.create(path, SCENE) as store:
        store.begin_sweep()
        store.append(np.arange(20), states, scans.strain_at(states))
    return path


def loaded(path) -> Scan:
    with ScanStore.open(path) as store:
        return store.load()


def test_results_are_loaded_for_the_same_data_only(path):
    assert load_learned(path, "widths 1", "a") is None
    assert store_learned(path, LearnedEntry("widths 1", "a", b"first"))
    assert store_learned(path, LearnedEntry("widths 1", "b", PAYLOAD))
    assert store_learned(path, LearnedEntry("fit 1", "b", b""))
    assert load_learned(path, "widths 1", "b") == PAYLOAD
    assert load_learned(path, "fit 1", "b") == b""
    assert load_learned(path, "widths 1", "a") is None
    assert load_learned(path, "widths 2", "b") is None


def test_storing_a_result_keeps_the_pairs(path):
    before = digest_of(loaded(path), SCENE)
    store_learned(path, LearnedEntry("widths 1", before, PAYLOAD))
    assert digest_of(loaded(path), SCENE) == before
    assert [file.name for file in path.parent.iterdir()] == ["scan.db"]


def test_the_table_is_added_to_older_files(path):
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("DROP TABLE IF EXISTS learned")
    assert load_learned(path, "widths 1", "a") is None
    assert store_learned(path, LearnedEntry("widths 1", "a", PAYLOAD))
    assert load_learned(path, "widths 1", "a") == PAYLOAD


@pytest.mark.parametrize("column", ["payload", "digest", "key"])
def test_a_damaged_result_is_ignored(path, column):
    store_learned(path, LearnedEntry("widths 1", "a", PAYLOAD))
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute(f"UPDATE learned SET {column} = ?", (b"b" if column == "payload" else "b",))
    asked = {"key": "widths 1", "digest": "a", column: "b"}
    assert load_learned(path, asked["key"], asked["digest"]) is None


@pytest.fixture(autouse=True)
def propagating(monkeypatch):
    """Loggers that are made after ``launch`` has been imported, as by its pytest plugin, do not propagate."""
    monkeypatch.setattr(logging.getLogger("tactile_localizer.io.scans.learned"), "propagate", True)


def test_a_locked_file_gives_a_warning(path, caplog, monkeypatch):
    monkeypatch.setattr(scan_lock, "LOCK_TIMEOUT_S", 0.0)
    with caplog.at_level(logging.WARNING), ScanStore.open(path, writable=True) as recorder:
        recorder.begin_sweep()
        assert not store_learned(path, LearnedEntry("widths 1", "a", PAYLOAD))
        assert not store_learned(path, LearnedEntry("widths 1", "a", PAYLOAD))
    assert len(caplog.messages) == 2
    assert "widths 1 could not be stored for the next start" in caplog.text
    assert "expected no other writer" in caplog.text
    assert load_learned(path, "widths 1", "a") is None


def test_unusable_files_raise_nothing(tmp_path, caplog):
    text = tmp_path / "text.db"
    text.write_text("no database" * 1000)
    for path in (text, tmp_path / "none.db", tmp_path, tmp_path / "none" / "scan.db"):
        assert load_learned(path, "widths 1", "a") is None
        assert not store_learned(path, LearnedEntry("widths 1", "a", PAYLOAD))
    assert len(caplog.messages) == 4


def test_a_recorder_waits_for_the_lock(path, monkeypatch):
    monkeypatch.setattr(scan_lock, "LOCK_TIMEOUT_S", 10.0)
    release = threading.Timer(0.05, scan_lock.ScanLock(path).release)
    release.start()
    ScanStore.open(path, writable=True).close()
    release.join()


def test_the_digest_changes_with_scan_and_scene(path):
    scan = loaded(path)
    digest = digest_of(scan, SCENE)
    strain = scan.strain.copy()
    strain[7, 3] = np.nextafter(strain[7, 3], 1.0)
    states = scan.states.copy()
    states[0, 0] += 1e-9
    others = [
        digest_of(replace(scan, strain=strain), SCENE),
        digest_of(replace(scan, states=states), SCENE),
        digest_of(replace(scan, sweep=scan.sweep + 1), SCENE),
        digest_of(scan.select(np.arange(19)), SCENE),
        digest_of(scan, replace(SCENE, name="other")),
        digest_of(scan, replace(SCENE, measurement={"neighbours": 7})),
        digest_of(scan, replace(SCENE, phalanges=SCENE.phalanges[:1])),
    ]
    assert len({digest, *others}) == 1 + len(others)


def test_equal_scans_and_scenes_have_equal_digests(path):
    scan = loaded(path)
    same = Scan(
        np.asfortranarray(scan.states), scan.strain, scan.sweep.astype(np.int32), scan.axes, scan.phalanges
    )
    given = {"position_std": [0.001, 0.002], "correlation_length": 1}
    as_numpy = {"correlation_length": np.float64(1.0), "position_std": np.array([0.001, 0.002])}
    assert digest_of(scan, replace(SCENE, measurement=given)) == digest_of(
        same, replace(SCENE, measurement=as_numpy)
    )
    assert digest_of(scan, SCENE) == digest_of(loaded(path), scans.scene())
