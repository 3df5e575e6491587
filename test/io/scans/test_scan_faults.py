"""What can happen to a scan: kills, flipped bytes, two writers."""

import multiprocessing
import os
import signal
import time

import numpy as np
import pytest

from tactile_localizer.errors import ScanError
from tactile_localizer.io.recording import RecordedSweep
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scans.writer import ScanWriter
from tactile_localizer.scene import Axis, Phalanx, Scene

SCENE = Scene("line", (Axis("x", 0.0, 1.0),), (Phalanx("index", (0.0,)),))
SWEEPS, PAIRS = 4, 100


def numbered(start, n):
    """Pairs that carry their own number."""
    number = np.arange(start, start + n)
    return number, np.full((n, 1), 0.5), np.tile(number[:, None].astype(float), (1, 8))


@pytest.fixture
def path(tmp_path):
    with ScanWriter(tmp_path / "scan", SCENE) as writer:
        for number in range(1, SWEEPS + 1):
            writer.add(RecordedSweep(number, *numbered(1000 * number, PAIRS), np.zeros((PAIRS, 1))))
    return tmp_path / "scan"


def write_until_killed(path, written):
    with ScanWriter(path, SCENE) as writer:
        while True:
            sweep = writer.begin_sweep()
            for start in range(0, 100, 5):
                sweep.append(*numbered(1_000_000 * sweep.number + start, 5))
                written.value += 5
            sweep.end()


def test_kill_9_at_ten_moments_loses_no_pair_that_was_written(path):
    context = multiprocessing.get_context("fork")
    stored = SWEEPS * PAIRS
    for moment in range(10):
        written = context.Value("q", 0, lock=False)  # the killed process could hold a lock
        process = context.Process(target=write_until_killed, args=(path, written))
        process.start()
        while written.value < 40 * moment + 5:
            time.sleep(0.001)
        time.sleep(0.0007 * moment)
        os.kill(process.pid, signal.SIGKILL)
        process.join()
        ScanWriter(path, SCENE).close()
        sweeps = ScanFolder(path).recording().sweeps
        total = sum(map(len, sweeps))
        # 5 more where it was killed between writing and counting.
        assert total - stored - written.value in (0, 5)
        for sweep in sweeps:
            np.testing.assert_array_equal(sweep.strain[:, 0], sweep.stamp_ns)
        stored = total


def test_damage_costs_the_damaged_pairs_only(path):
    """Flipped, missing and additional bytes, whatever the process that recorded them did."""
    rng = np.random.default_rng(0)
    file = path / "sweep_0002.npy"
    good = file.read_bytes()
    for _ in range(60):
        at = int(rng.integers(len(good)))
        flipped = bytes([good[at] ^ 1 << int(rng.integers(8))])
        for content in (good[:at] + flipped + good[at + 1 :], good[:at] + good[at + 1 :], good[:at]):
            file.write_bytes(content)
            found = ScanFolder(path).recording()
            kept = [len(sweep) for sweep in found.sweeps if sweep.number == 2]
            assert len(found) == (SWEEPS - 1) * PAIRS + sum(kept)
            for sweep in found.sweeps:
                np.testing.assert_array_equal(sweep.strain[:, 0], sweep.stamp_ns)
            if len(content) >= len(good) - 1:
                assert kept[0] >= PAIRS - 1
                assert kept[0] == PAIRS or "sweep_0002.npy: 1 of 100 pairs are damaged" in found.notes[0]
            assert file.read_bytes() == content


@pytest.mark.parametrize("part", [slice(None), slice(300, 4000), slice(0, 2000)])
def test_a_part_that_is_in_a_file_twice_counts_once(path, part):
    """As after an interrupted copy that was continued: stamps of a sweep increase."""
    file = path / "sweep_0002.npy"
    good = file.read_bytes()
    file.write_bytes(good[: part.stop] + good[part])
    found = ScanFolder(path).recording()
    for sweep in found.sweeps:
        assert (np.diff(sweep.stamp_ns) > 0).all()
        np.testing.assert_array_equal(sweep.strain[:, 0], sweep.stamp_ns)
    assert "sweep_0002.npy" in found.notes[0]


def test_a_second_writer_is_refused(path):
    with ScanWriter(path, SCENE) as writer:
        with pytest.raises(ScanError, match="scan: expected no other writer, another process is writing it"):
            ScanWriter(path, SCENE)
        (path.parent / "alias").symlink_to(path)
        with pytest.raises(ScanError, match="another process is writing it"):
            ScanWriter(path.parent / "alias", SCENE)
        writer.begin_sweep()
    assert len(ScanFolder(path).load()) == SWEEPS * PAIRS


def test_a_foreign_folder_is_left_alone(tmp_path):
    (tmp_path / "holiday.jpg").touch()
    with pytest.raises(ScanError, match="expected a scan or an empty folder, found other files"):
        ScanWriter(tmp_path, SCENE)
    with pytest.raises(ScanError, match=r"jpg/scan: expected a folder that can be written, Not a dir"):
        ScanWriter(tmp_path / "holiday.jpg" / "scan", SCENE)
    assert [file.name for file in tmp_path.iterdir()] == ["holiday.jpg"]


def test_a_writer_that_died_while_it_made_the_scan_leaves_no_obstacle(tmp_path):
    (tmp_path / "scan").mkdir()
    (tmp_path / "scan" / "history.jsonl").touch()
    (tmp_path / "scan" / ".scene.4711.yaml").touch()
    with ScanWriter(tmp_path / "scan", SCENE) as writer:
        writer.add(RecordedSweep(1, *numbered(0, 5), np.zeros((5, 1))))
    assert len(ScanFolder(tmp_path / "scan").load()) == 5
