"""Imports keep the same pairs as live recording, and report skipped samples."""

import resource
import signal

import numpy as np
import pytest
from support.notes import counts

from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import RecordedSweep, Recording
from tactile_localizer.io.scans.importer import import_recording
from tactile_localizer.io.scans.store import ScanStore, new_scan
from tactile_localizer.io.status import MISSING, SATURATED
from tactile_localizer.scene import Axis, Phalanx, Scene

SCENE = Scene("line", (Axis("x", 0, 1),), (Phalanx("index", (0,)),))


def sweep_of(number: int, x: list[float], **changes: object) -> RecordedSweep:
    n = len(x)
    values = {
        "stamp_ns": np.arange(n, dtype=np.int64),
        "position": np.array(x)[:, None],
        "strain": np.arange(8.0 * n).reshape(n, 8),
        "status": np.zeros((n, 1), dtype=np.uint8),
    }
    return RecordedSweep(number, **{**values, **changes})


def recording_of(*sweeps: RecordedSweep) -> Recording:
    return Recording("source", ("x",), ("index",), sweeps, ("one note",))


def test_unusable_samples_are_skipped_and_counted(tmp_path):
    status = np.array([[0], [MISSING], [SATURATED], [0], [SATURATED | MISSING]], dtype=np.uint8)
    strain = np.zeros((5, 8))
    strain[3, 2] = np.nan
    recording = recording_of(
        sweep_of(3, [0.5] * 5, status=status, strain=strain, gaps=4), sweep_of(7, [-0.1, 0.0, 0.5, 1.0, 1.1])
    )
    report = import_recording(recording, SCENE, tmp_path / "scan.db", what="test", detail={}, force=True)
    assert (report.sweeps, report.pairs) == (2, 4)
    assert report.notes[0] == "one note"
    assert counts(report.notes) == [(2, 14), (3, 14), (1, 14), (4, 14)]
    for note, reason in zip(report.notes[1:], ("bounds", "missing", "saturated", "pose"), strict=True):
        assert reason in note
    assert "x is -0.1 to 1.1" in report.notes[1]
    with ScanStore.open(tmp_path / "scan.db") as store:
        assert [(s.number, s.pairs, s.gaps, s.skipped) for s in store.sweeps()] == [
            (3, 1, 4, 4),
            (7, 3, 0, 2),
        ]
        np.testing.assert_array_equal(store.load().states[:, 0], [0.5, 0.0, 0.5, 1.0])
        ((_, what, detail),) = store.history()
        assert (what, tuple(detail["notes"])) == ("test", report.notes)


def test_empty_sweeps_are_skipped(tmp_path):
    recording = recording_of(sweep_of(1, [2.0, 3.0]), sweep_of(2, [0.5]))
    report = import_recording(recording, SCENE, tmp_path / "scan.db", what="test", detail={}, force=True)
    assert report.sweeps == 1
    assert counts(report.notes)[-1] == (1, 2)


def test_an_empty_import_leaves_no_file(tmp_path):
    with pytest.raises(ScanError, match="source: expected usable samples; one note; skipped 2 of 2"):
        import_recording(
            recording_of(sweep_of(1, [2.0, 3.0])), SCENE, tmp_path / "a.db", what="test", detail={}
        )
    assert list(tmp_path.iterdir()) == []


def test_import_does_not_overwrite(tmp_path):
    (tmp_path / "scan.db").write_text("precious")
    with pytest.raises(ScanError, match="expected no file of this name"):
        import_recording(
            recording_of(sweep_of(1, [0.5])), SCENE, tmp_path / "scan.db", what="test", detail={}
        )
    assert (tmp_path / "scan.db").read_text() == "precious"


def test_import_on_a_full_disk_leaves_no_file(tmp_path):
    recording = recording_of(*(sweep_of(number, [0.5] * 5000) for number in range(1, 19)))
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        # Room for SQLite's log, which is begun anew now and then, but not for the file at the end.
        resource.setrlimit(resource.RLIMIT_FSIZE, (5_200_000, limit[1]))
        with pytest.raises(ScanError, match=r"scan\.db: expected enough disk space"):
            import_recording(recording, SCENE, tmp_path / "scan.db", what="test", detail={})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
        signal.signal(signal.SIGXFSZ, ignored)
    assert list(tmp_path.iterdir()) == []


def test_simultaneous_imports_do_not_interfere(tmp_path):
    first = new_scan(tmp_path / "scan.db", SCENE)
    store = first.__enter__()
    store.begin_sweep()
    store.append(np.arange(3), np.zeros((3, 1)), np.zeros((3, 8)))
    import_recording(recording_of(sweep_of(1, [0.5])), SCENE, tmp_path / "other.db", what="test", detail={})
    with pytest.raises(ScanError, match="expected usable samples"):
        import_recording(
            recording_of(sweep_of(1, [2.0])), SCENE, tmp_path / "scan.db", what="test", detail={}
        )
    first.__exit__(None, None, None)
    with ScanStore.open(tmp_path / "scan.db") as scan:
        assert len(scan.load()) == 3
