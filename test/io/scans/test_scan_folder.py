"""A scan is a folder of sweeps that reads back what was written."""

import json
import shutil

import numpy as np
import pytest

from tactile_localizer.errors import ScanError, SceneError
from tactile_localizer.io.recording import RecordedSweep
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scans.writer import ScanWriter
from tactile_localizer.scene import Axis, Phalanx, Scene

SCENE = Scene(
    "sheet",
    (Axis("x", 0.0, 0.05), Axis("y", 0.0, 0.05)),
    (Phalanx("index", (0, 0)), Phalanx("middle", (0, 0))),
)


def pairs(n=10, seed=0):
    rng = np.random.default_rng(seed)
    return np.arange(n) * 5_000_000, rng.uniform(0, 0.05, (n, 2)), rng.normal(size=(n, 16))


def record(path, sweeps=3, n=10):
    with ScanWriter(path, SCENE) as writer:
        for number in range(1, sweeps + 1):
            writer.add(RecordedSweep(number, *pairs(n, number), np.zeros((n, 2)), gaps=number, skipped=2))
    return ScanFolder(path)


def test_a_recorded_scan_reads_back(tmp_path):
    with ScanWriter(tmp_path / "scan", SCENE, strain_unit="counts") as writer:
        one, two = writer.begin_sweep(), writer.begin_sweep()
        writer.append(two, *pairs(seed=3))
        for seed in (1, 2):
            writer.append(one, *pairs(seed=seed))
        one.gaps, one.skipped = 3, 4
        writer.end_sweep(one)
        writer.note("test", files=["a.csv"])
    scan = ScanFolder(tmp_path / "scan")
    first, second = scan.sweeps()
    assert (first.number, len(first), first.gaps, first.skipped, first.ending) == (1, 20, 3, 4, "ended")
    assert (second.number, second.strain_unit) == (2, "counts")
    assert (second.started_ns, second.ended_ns) == (0, 45_000_000)
    np.testing.assert_array_equal(first.stamp_ns, np.tile(pairs()[0], 2))
    loaded = scan.load()
    np.testing.assert_array_equal(loaded.states, np.concatenate([pairs(seed=seed)[1] for seed in (1, 2, 3)]))
    np.testing.assert_array_equal(loaded.strain, np.concatenate([pairs(seed=seed)[2] for seed in (1, 2, 3)]))
    np.testing.assert_array_equal(loaded.sweep, [1] * 20 + [2] * 10)
    assert scan.scene == SCENE
    assert [sweep.number for sweep in scan.recording().sweeps] == [1, 2]
    (entry,) = scan.history()
    assert (entry["what"], entry["files"]) == ("test", ["a.csv"])
    assert sorted(file.name for file in scan.path.iterdir()) == [
        "history.jsonl", "scene.yaml", "sweep_0001.npz", "sweep_0002.npz",
    ]  # fmt: skip


def test_numpy_reads_a_sweep(tmp_path):
    record(tmp_path / "scan")
    with np.load(tmp_path / "scan" / "sweep_0002.npz") as file:
        np.testing.assert_array_equal(file["strain"], pairs(seed=2)[2])
        assert (str(file["ending"]), int(file["ended_ns"]), list(file["axes"])) == (
            "ended",
            45_000_000,
            ["x", "y"],
        )


def test_a_sweep_written_by_numpy_is_read(tmp_path):
    scan = record(tmp_path / "scan")
    file = tmp_path / "scan" / "sweep_0002.npz"
    with np.load(file) as found:
        arrays = {**found, "strain": found["strain"] + 1.0}
    np.savez(file, **arrays)
    np.testing.assert_array_equal(scan.sweeps()[1].strain, pairs(seed=2)[2] + 1.0)


def test_a_dropped_sweep_is_moved_and_its_number_stays_in_use(tmp_path):
    scan = record(tmp_path / "scan")
    (scan.path / "dropped").mkdir()
    (scan.path / "sweep_0003.npz").rename(scan.path / "dropped" / "sweep_0003.npz")
    assert [sweep.number for sweep in scan.sweeps()] == [1, 2]
    with ScanWriter(scan.path, SCENE) as writer:
        assert writer.begin_sweep().number == 4


def test_merging_is_copying(tmp_path):
    one, two = record(tmp_path / "one", sweeps=2), record(tmp_path / "two", sweeps=3)
    shutil.copy(two.path / "sweep_0003.npz", one.path)
    assert [sweep.number for sweep in one.sweeps()] == [1, 2, 3]
    shutil.copy(two.path / "sweep_0001.npz", one.path / "sweep_0004.npz")
    with pytest.raises(
        ScanError, match="one: expected every sweep once, found sweep 4 equal to sweep 1; move one"
    ):
        one.load()


def test_readers_see_a_sweep_in_progress(tmp_path):
    scan = record(tmp_path / "scan", sweeps=1)
    with ScanWriter(scan.path, SCENE) as writer:
        writer.append(writer.begin_sweep(), *pairs(5, seed=9))
        assert [(len(sweep), sweep.ending) for sweep in scan.sweeps()] == [(10, "ended"), (5, "ended early")]
    assert scan.sweeps()[1].ending == "ended"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"strain": np.full((10, 16), np.nan)}, "strain: expected finite values of at most 1e.10, found nan"),
        (
            {"position": np.full((10, 2), 1e6)},
            r"position: expected finite values of at most 1000, found 1e\+06",
        ),
        ({"position": np.zeros((10, 1))}, "expected integers and floats of shapes"),
        ({"stamp_ns": np.zeros(10)}, "expected integers and floats"),
    ],
)
def test_implausible_values_are_damage(tmp_path, changes, message):
    scan = record(tmp_path / "scan")
    file = tmp_path / "scan" / "sweep_0002.npz"
    with np.load(file) as found:
        arrays = {**found, **changes}
    np.savez(file, **arrays)
    with pytest.raises(ScanError, match=rf"sweep_0002\.npz: damaged, {message}"):
        scan.load()


def test_another_scene_is_refused(tmp_path):
    scan = record(tmp_path / "scan")
    other = Scene("sheet", (Axis("x", 0.0, 0.06), SCENE.axes[1]), SCENE.phalanges)
    with pytest.raises(ScanError, match=r"scan: expected axes x 0 to 0\.06, y .*, found x 0 to 0\.05"):
        ScanWriter(scan.path, other)
    one_finger = Scene("sheet", SCENE.axes, SCENE.phalanges[:1])
    with ScanWriter(tmp_path / "other", one_finger) as writer:
        writer.add(RecordedSweep(9, *pairs()[:2], pairs()[2][:, :8], np.zeros((10, 1))))
    shutil.copy(tmp_path / "other" / "sweep_0009.npz", scan.path)
    with pytest.raises(ScanError, match=r"sweep_0009\.npz: damaged, expected phalanges"):
        scan.load()


def test_a_damaged_history_is_no_obstacle(tmp_path):
    scan = record(tmp_path / "scan")
    lines = ["{", "[]", '{"at": 7}', "\x00", "[" * 100_000, json.dumps({"at": "now", "what": "test"})]
    (scan.path / "history.jsonl").write_text("\n".join(lines) + "\n")
    *damaged, last = [entry["what"] for entry in scan.history()]
    assert last == "test"
    assert all(what.startswith("unreadable line") for what in damaged)


def foreign_folder(path):
    path.mkdir()
    (path / "holiday.jpg").touch()
    return ScanError, "expected a scan folder, found a folder without scene.yaml"


def damaged_scene(path):
    record(path)
    (path / "scene.yaml").write_text("axes: 7\n")
    return SceneError, "axes: expected a mapping"


def misnamed_sweep(path):
    record(path)
    (path / "sweep_0001.npz").rename(path / "sweep_1b.npz")
    return ScanError, "sweep_1b.npz: expected a name like sweep_0001.npz"


def twice_the_same_number(path):
    record(path)
    shutil.copy(path / "sweep_0001.npz", path / "sweep_001.npz")
    return ScanError, "expected one file of sweep 1, found another"


@pytest.mark.parametrize("make", [foreign_folder, damaged_scene, misnamed_sweep, twice_the_same_number])
def test_what_is_no_scan_is_refused_in_one_line(tmp_path, make):
    kind, message = make(tmp_path / "scan")
    with pytest.raises(kind, match="scan") as error:
        ScanFolder(tmp_path / "scan").load()
    assert message in str(error.value)
