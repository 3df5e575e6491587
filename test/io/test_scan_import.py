"""An import keeps what recording live would have kept, and says what it left out."""

import numpy as np
import pytest

from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import RecordedSweep, Recording
from tactile_localizer.io.scan_import import import_recording
from tactile_localizer.io.scan_store import ScanStore
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


def test_samples_out_of_bounds_missing_or_saturated_are_left_out_and_counted(tmp_path):
    status = np.array([[0], [MISSING], [SATURATED], [0], [SATURATED | MISSING]], dtype=np.uint8)
    strain = np.zeros((5, 8))
    strain[3, 2] = np.nan
    recording = recording_of(
        sweep_of(3, [0.5] * 5, status=status, strain=strain, gaps=4), sweep_of(7, [-0.1, 0.0, 0.5, 1.0, 1.1])
    )
    report = import_recording(recording, SCENE, tmp_path / "scan.db", what="test", detail={})
    assert (report.sweeps, report.pairs) == (2, 4)
    assert report.notes == (
        "one note",
        "left out 2 of 14 samples with a palm position outside the scene's bounds"
        " (x is -0.1 to 1.1, bounds 0 to 1)",
        "left out 3 of 14 samples with missing strain",
        "left out 1 of 14 samples with saturated strain",
        "left out 4 of 14 samples without a palm pose near enough in time",
    )
    with ScanStore.open(tmp_path / "scan.db") as store:
        assert [(s.number, s.pairs, s.gaps, s.skipped) for s in store.sweeps()] == [
            (3, 1, 4, 4),
            (7, 3, 0, 2),
        ]
        np.testing.assert_array_equal(store.load().states[:, 0], [0.5, 0.0, 0.5, 1.0])
        ((_, what, detail),) = store.history()
        assert (what, tuple(detail["notes"])) == ("test", report.notes)


def test_a_sweep_of_which_nothing_is_left_is_not_in_the_file(tmp_path):
    recording = recording_of(sweep_of(1, [2.0, 3.0]), sweep_of(2, [0.5]))
    report = import_recording(recording, SCENE, tmp_path / "scan.db", what="test", detail={})
    assert report.sweeps == 1
    assert report.notes[-1] == "left out 1 of 2 sweeps whole: 1"


def test_an_import_without_any_pair_is_refused_and_leaves_no_file(tmp_path):
    with pytest.raises(ScanError, match="source: expected samples for a scan; one note; left out 2 of 2"):
        import_recording(
            recording_of(sweep_of(1, [2.0, 3.0])), SCENE, tmp_path / "a.db", what="test", detail={}
        )
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_exists_is_not_written_over(tmp_path):
    (tmp_path / "scan.db").write_text("precious")
    with pytest.raises(ScanError, match="expected no file of this name yet"):
        import_recording(
            recording_of(sweep_of(1, [0.5])), SCENE, tmp_path / "scan.db", what="test", detail={}
        )
    assert (tmp_path / "scan.db").read_text() == "precious"
