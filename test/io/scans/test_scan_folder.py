"""A scan is a folder of sweeps that reads back what was written; what cannot be read is named, not used."""

import json
import logging
import os
import re
import resource
import shutil
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactile_localizer.errors import ScanError, SceneError
from tactile_localizer.io.recording import RecordedSweep
from tactile_localizer.io.scans import folder
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scans.writer import ScanWriter
from tactile_localizer.scene import Axis, Phalanx, Region, Scene

SCENE = Scene(
    "sheet",
    (Axis("x", 0.0, 0.05), Axis("y", 0.0, 0.05)),
    (Phalanx("index", (0.0, 0.0)), Phalanx("middle", (0.0, 0.0))),
    Region((0.01, -np.inf), (0.02, np.inf)),
)


def pairs(n=10, seed=0):
    rng = np.random.default_rng(seed)
    return np.arange(n) * 5_000_000, rng.uniform(0, 0.05, (n, 2)), rng.normal(size=(n, 16))


def record(path, sweeps=3, n=10, scene=SCENE):
    with ScanWriter(path, scene) as writer:
        for number in range(1, sweeps + 1):
            writer.add(RecordedSweep(number, *pairs(n, number), np.zeros((n, 2)), gaps=number, skipped=2))
    return ScanFolder(path)


def test_a_recorded_scan_reads_back(tmp_path, monkeypatch):
    on_disk = []
    monkeypatch.setattr(os, "fdatasync", lambda file: on_disk.append(os.fstat(file).st_size))
    with ScanWriter(tmp_path / "new" / "scan", SCENE) as writer:
        one, two = writer.begin_sweep(), writer.begin_sweep()
        two.append(*pairs(seed=3))
        for seed in (1, 2):
            stamp_ns, *values = pairs(seed=seed)
            one.append(stamp_ns + 50_000_000 * (seed - 1), *values)
        one.gaps, one.skipped, one.strain_unit, two.strain_unit = 3, 4, "counts", "counts"
        one.end()
        two.end()
        writer.note("test", files=["a.csv"])
    scan = ScanFolder(tmp_path / "new" / "scan")
    sizes = [file.stat().st_size for _, file in sorted(scan.files()[0].items())]
    assert len(on_disk) == 3 + 2, "once for each append and each end"
    assert on_disk[3:] == sizes
    assert on_disk[2] - on_disk[1] == 10 * (8 + 8 * 18 + 4), "all that was appended"
    first, second = scan.recording().sweeps
    assert (first.number, len(first), first.gaps, first.skipped, first.ending) == (1, 20, 3, 4, "ended")
    assert (second.number, second.strain_unit, second.ending) == (2, "counts", "ended")
    np.testing.assert_array_equal(first.stamp_ns, pairs(20)[0])
    loaded = scan.load()
    np.testing.assert_array_equal(loaded.states, np.concatenate([pairs(seed=seed)[1] for seed in (1, 2, 3)]))
    np.testing.assert_array_equal(loaded.strain, np.concatenate([pairs(seed=seed)[2] for seed in (1, 2, 3)]))
    np.testing.assert_array_equal(loaded.sweep, [1] * 20 + [2] * 10)
    assert scan.scene == SCENE
    (entry,) = scan.history()
    assert (entry["what"], entry["files"]) == ("test", ["a.csv"])
    assert sorted(file.name for file in scan.path.iterdir()) == [
        "history.jsonl", "scene.yaml", "sweep_0001.npy", "sweep_0002.npy",
    ]  # fmt: skip


def test_each_recording_is_a_session(tmp_path):
    assert record(tmp_path / "scan").load().sessions == ()
    for first in (4, 6, 6):
        with ScanWriter(tmp_path / "scan", SCENE) as writer:
            writer.note("record", sessions=[writer.last_number + 1])
            if writer.last_number < 7:
                for number in (first, first + 1):
                    writer.add(RecordedSweep(number, *pairs(seed=number), np.zeros((10, 2))))
    scan = ScanFolder(tmp_path / "scan").load()
    assert scan.sessions == (1, 4, 6)
    assert scan.session.tolist() == [1, 1, 1, 2, 2, 3, 3]


def test_numpy_reads_a_sweep(tmp_path):
    record(tmp_path / "scan", n=1000)
    found = np.load(tmp_path / "scan" / "sweep_0002.npy")
    for name, values in zip(("stamp_ns", "position", "strain"), pairs(1000, 2), strict=True):
        np.testing.assert_array_equal(found[name], values)


def test_a_dropped_sweep_is_moved_and_its_number_stays_in_use(tmp_path):
    scan = record(tmp_path / "scan")
    (scan.path / "dropped").mkdir()
    (scan.path / "sweep_0003.npy").rename(scan.path / "dropped" / "sweep_0003.npy")
    assert [sweep.number for sweep in scan.recording().sweeps] == [1, 2]
    with ScanWriter(scan.path, SCENE) as writer:
        assert writer.begin_sweep().number == 4


def of_another_unit(path):
    with ScanWriter(path, SCENE) as writer:
        writer.add(RecordedSweep(4, *pairs(seed=4), np.zeros((10, 2)), strain_unit="counts"))


def of_another_scene(path):
    with ScanWriter(path.parent / "other", replace(SCENE, phalanges=SCENE.phalanges[:1])) as writer:
        writer.add(RecordedSweep(9, *pairs()[:2], pairs()[2][:, :8], np.zeros((10, 1))))
    shutil.copy(path.parent / "other" / "sweep_0009.npy", path)


def of_another_scene_in_progress(path):
    scene = replace(SCENE, axes=(Axis("x", 0.0, 0.06), SCENE.axes[1]))
    with ScanWriter(path.parent / "other", scene) as writer:
        writer.begin_sweep().append(*pairs(seed=8))
    shutil.copy(path.parent / "other" / "sweep_0001.npy", path / "sweep_0009.npy")


def copied_to(name):
    return lambda path: shutil.copy(path / "sweep_0001.npy", path / name)


UNUSABLE = [
    (
        "sweep_0004.npy",
        copied_to("sweep_0004.npy"),
        "expected every sweep once, found sweep 4 equal to sweep 1",
    ),
    ("sweep_0004 (1).npy", copied_to("sweep_0004 (1).npy"), "expected a name like sweep_0001.npy"),
    ("sweep_001.npy", copied_to("sweep_001.npy"), "expected a name like sweep_0001.npy, of one sweep"),
    ("sweep_0004.npy", of_another_unit, "expected strain in V, found counts"),
    ("sweep_0009.npy", of_another_scene, "expected the phalanges .*'middle'.*, found .*'index'"),
    ("sweep_0009.npy", of_another_scene_in_progress, "expected pairs of the scan's scene, found none"),
    (
        "sweep_0009.npy",
        lambda path: np.save(path / "sweep_0009.npy", np.zeros(300)),
        "expected pairs of the scan",
    ),
    ("sweep_0009.npy", lambda path: os.mkfifo(path / "sweep_0009.npy"), "found no regular file"),
    (
        "sweep_0009.npy",
        lambda path: (path / "sweep_0009.npy").symlink_to("/dev/zero"),
        "found no regular file",
    ),
]


@pytest.mark.parametrize("name", ["sweep_0002.npy", "history.jsonl"])
def test_a_huge_file_is_read_in_part(tmp_path, name):
    """As after the repair of a file system: of some GB, almost all of them zeros."""
    scan = record(tmp_path / "scan")
    (scan.path / name).touch()
    os.truncate(scan.path / name, 5 * 2**30)
    begin, limit = time.process_time(), resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + 2**28, limit[1]))
    try:
        found, _ = scan.recording(), scan.history()
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limit)
    assert [(len(sweep), sweep.gaps, sweep.ending) for sweep in found.sweeps] == [
        (10, number, "ended") for number in (1, 2, 3)
    ]
    assert len(found.notes) == name.startswith("sweep")
    assert all("pairs are damaged and not used" in note for note in found.notes)
    assert time.process_time() - begin < 20.0


def test_a_megabyte_of_damage_costs_no_pair_behind_it_and_no_time(tmp_path):
    phalanges = tuple(Phalanx(f"p{n}", (0.0, 0.0), 256) for n in range(16))
    scene, rng = replace(SCENE, phalanges=phalanges), np.random.default_rng(0)
    with ScanWriter(tmp_path / "scan", scene) as writer:
        writer.begin_sweep().append(np.arange(20), rng.random((20, 2)), rng.random((20, 4096)))
    file = tmp_path / "scan" / "sweep_0001.npy"
    content = file.read_bytes()
    file.write_bytes(content[:100_000] + b"x" + content[100_000:])
    begin = time.process_time()
    found = ScanFolder(tmp_path / "scan").recording()
    assert len(found) == 19
    assert time.process_time() - begin < 20.0


@pytest.mark.parametrize("sizes", [(0,), (60,), (100,), (None,), (0, 0, 0)])
def test_a_sweep_without_pairs_is_named(tmp_path, sizes, caplog, monkeypatch):
    """A power cut or an interrupted copy leaves no bytes, a part of the header or all of it."""
    scan = record(tmp_path / "scan")
    for number, size in enumerate(sizes, 1):
        with ScanWriter(tmp_path / "header", SCENE) as writer:
            writer.begin_sweep(number=number)
        shutil.copy(tmp_path / "header" / f"sweep_{number:04}.npy", scan.path)
        if size is not None:
            os.truncate(scan.path / f"sweep_{number:04}.npy", size)
    found = scan.recording()
    assert list(found.notes) == [
        f"{scan.path}/sweep_{number:04}.npy: sweep {number} has no pairs"
        for number in range(1, len(sizes) + 1)
    ]
    assert [sweep.number for sweep in found.sweeps] == [1, 2, 3][len(sizes) :]
    monkeypatch.setattr(logging.getLogger(folder.__name__), "propagate", True)
    with suppress(ScanError):
        scan.load()
    assert "sweep 1 has no pairs" in caplog.text
    with ScanWriter(scan.path, SCENE) as writer:
        assert writer.begin_sweep().number == 4


@pytest.mark.parametrize(("name", "make", "message"), UNUSABLE)
def test_a_file_that_cannot_be_used_is_named_and_the_others_are_used(tmp_path, name, make, message):
    scan = record(tmp_path / "scan")
    make(scan.path)
    files = sorted(scan.path.iterdir())
    found = scan.recording()
    (line,) = found.notes
    assert [sweep.number for sweep in found.sweeps] == [1, 2, 3]
    assert line.startswith(f"{scan.path / name}: ")
    assert re.search(rf"{message}.*not used$", line)
    assert "\n" not in line
    assert len(scan.load()) == 30
    with ScanWriter(scan.path, SCENE) as writer:
        assert writer.begin_sweep().number >= 4
    assert set(files) <= set(scan.path.iterdir())


def test_a_scan_without_a_sweep_that_can_be_used_is_refused(tmp_path):
    scan = record(tmp_path / "scan", sweeps=2)
    for file in scan.path.glob("*.npy"):
        file.write_bytes(b"x" * 10_000)
    with pytest.raises(ScanError, match=r"0001.npy: expected pairs .* not used, nor is any other"):
        scan.load()


def test_a_flipped_bit_of_the_scene_is_found(tmp_path):
    """Or it changes nothing, as in the line breaks."""
    scan = record(tmp_path / "scan", sweeps=1)
    file = scan.path / "scene.yaml"
    good = file.read_bytes()
    for place in range(0, 8 * len(good), 5):
        content = bytearray(good)
        content[place // 8] ^= 1 << place % 8
        file.write_bytes(content)
        try:
            assert ScanFolder(scan.path).load() is not None
        except (ScanError, SceneError):
            continue
        assert ScanFolder(scan.path).scene == SCENE


def test_a_damaged_history_is_no_obstacle(tmp_path):
    scan = record(tmp_path / "scan")
    lines = ["{", "[]", '{"at": 7}', "\x00", "[" * 100_000, json.dumps({"at": "now", "what": "test"})]
    (scan.path / "history.jsonl").write_text("\n".join(lines) + "\n")
    *damaged, last = [entry["what"] for entry in scan.history()]
    assert last == "test"
    assert all(what.startswith("unreadable line") for what in damaged)
    (scan.path / "history.jsonl").unlink()
    os.mkfifo(scan.path / "history.jsonl")
    assert scan.history() == []
    with pytest.raises(ScanError, match="expected a folder that can be written"):
        ScanWriter(scan.path, SCENE)


def test_what_is_no_scan_is_refused_in_one_line(tmp_path):
    (tmp_path / "holiday.jpg").touch()
    for path in (tmp_path, tmp_path / "none", tmp_path / "holiday.jpg", "x" * 300, "a\0b"):
        with pytest.raises(ScanError, match="expected a scan folder, found none"):
            ScanFolder(path)
    record(tmp_path / "scan")
    (tmp_path / "scan" / "scene.yaml").write_text("axes: 7\n")
    with pytest.raises(SceneError, match="axes: expected a mapping"):
        ScanFolder(tmp_path / "scan")
