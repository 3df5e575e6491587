"""Imports keep the same pairs as live recording, and report skipped samples."""

import numpy as np
import pytest
from support.disk import full_disk
from support.notes import counts

from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import RecordedSweep, Recording, join
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scans.importer import import_recording
from tactile_localizer.io.status import FAULT, MISSING, SATURATED
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
    return Recording("source", sweeps, ("one note",))


@pytest.mark.parametrize(("sweeps", "sessions"), [((2, 3), (1, 3)), ((2, 1), ()), ((3,), ())])
def test_each_of_several_files_is_a_session_unless_one_is_a_single_sweep(tmp_path, sweeps, sessions):
    """The strokes of one session may have a file each."""
    files = [
        recording_of(*(sweep_of(1 + n, [0.1 * n + 0.01 * file, 0.5]) for n in range(count)))
        for file, count in enumerate(sweeps)
    ]
    import_recording(join(files), SCENE, tmp_path / "bump_scan")
    assert ScanFolder(tmp_path / "bump_scan").load().sessions == sessions


def test_unusable_samples_are_skipped_and_counted(tmp_path):
    status = np.array([[0], [FAULT], [SATURATED], [0], [SATURATED | MISSING]], dtype=np.uint8)
    strain = np.zeros((5, 8))
    strain[3, 2] = 1e300
    recording = recording_of(
        sweep_of(3, [0.5] * 5, status=status, strain=strain, gaps=4), sweep_of(7, [-0.1, 0.0, 0.5, 1.0, 1.1])
    )
    notes = import_recording(recording, SCENE, tmp_path / "bump_scan", force=True)
    assert notes[0] == "one note"
    assert counts(notes) == [(2, 14), (3, 14), (1, 14), (4, 14)]
    for note, reason in zip(notes[1:], ("bounds", "missing", "saturated", "pose"), strict=True):
        assert reason in note
    assert "x is -0.1 to 1.1" in notes[1]
    scan = ScanFolder(tmp_path / "bump_scan")
    assert [(s.number, len(s), s.gaps, s.skipped) for s in scan.recording().sweeps] == [
        (3, 1, 4, 4),
        (7, 3, 0, 2),
    ]
    np.testing.assert_array_equal(scan.load().states[:, 0], [0.5, 0.0, 0.5, 1.0])
    (entry,) = scan.history()
    assert (entry["what"], tuple(entry["notes"])) == ("import", notes)


def test_an_import_of_few_usable_samples_leaves_no_file(tmp_path):
    with pytest.raises(ScanError, match=r"source: one note; skipped 2 of 2 .*expected samples, found none"):
        import_recording(recording_of(sweep_of(1, [2.0, 3.0])), SCENE, tmp_path / "a_scan")
    with pytest.raises(
        ScanError, match=r"4 of 5 .* palm pose .*; expected at least half of 5 samples .* found 1"
    ):
        import_recording(recording_of(sweep_of(1, [0.5], gaps=4)), SCENE, tmp_path / "a_scan")
    assert list(tmp_path.iterdir()) == []


def test_a_refusal_names_its_file_once_and_no_sweeps(tmp_path):
    sweeps = tuple(sweep_of(number, [2.0 + 0.01 * number]) for number in range(3))
    recording = Recording("a.csv", sweeps, ("a.csv: one note",))
    with pytest.raises(ScanError) as error:
        import_recording(recording, SCENE, tmp_path / "a_scan")
    assert str(error.value).startswith("a.csv: one note; skipped 3 of 3")
    assert str(error.value).count("a.csv") == 1
    assert "no pairs" not in str(error.value)


def test_samples_that_could_not_be_read_count_as_unusable(tmp_path):
    readable = sweep_of(1, [0.5, 0.6])
    import_recording(Recording("source", (readable,), (), lost=2), SCENE, tmp_path / "half")
    with pytest.raises(ScanError, match="at least half of 5 samples to be usable, found 2"):
        import_recording(Recording("source", (readable,), (), lost=3), SCENE, tmp_path / "less")


def test_sweeps_without_pairs_are_named(tmp_path):
    sweeps = (sweep_of(1, [0.5, 0.6]), sweep_of(2, [2.0]), sweep_of(7, []))
    notes = import_recording(recording_of(*sweeps), SCENE, tmp_path / "bump_scan")
    assert notes[-1] == "no pairs: sweep 2, 7"
    assert [sweep.number for sweep in ScanFolder(tmp_path / "bump_scan").recording().sweeps] == [1]


def test_import_does_not_overwrite(tmp_path):
    (tmp_path / "bump_scan").write_text("precious")
    for name, message in (("bump_scan", "expected no folder of this"), ("x" * 300, "File name too long")):
        with pytest.raises(ScanError, match=message):
            import_recording(recording_of(sweep_of(1, [0.5])), SCENE, tmp_path / name)
    assert (tmp_path / "bump_scan").read_text() == "precious"


def test_import_on_a_full_disk_names_the_scan_and_leaves_nothing(tmp_path):
    recording = recording_of(sweep_of(1, [0.5] * 5000))
    with (
        full_disk(100_000),
        pytest.raises(ScanError, match=r"/bump_scan/sweep_0001.npy: could not be written, File too") as e,
    ):
        import_recording(recording, SCENE, tmp_path / "bump_scan")
    assert str(e.value).count("bump_scan") == 1
    assert list(tmp_path.iterdir()) == []
