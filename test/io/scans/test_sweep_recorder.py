"""Sweeps hold the samples between two stamps, even if their poses arrive late."""

import os
import shutil

import numpy as np
import pytest
from support.disk import full_disk

from tactile_localizer.errors import ScanError
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scans.recorder import SweepRecorder
from tactile_localizer.io.scans.sweep_files import OpenSweep
from tactile_localizer.io.scans.writer import ScanWriter
from tactile_localizer.io.status import MISSING
from tactile_localizer.scene import Axis, Phalanx, Scene
from tactile_localizer.streams import session as streams
from tactile_localizer.streams.coverage import Coverage
from tactile_localizer.streams.session import Pair
from tactile_localizer.streams.sweep_detector import NO_SWEEP, SweepDetector

SCENE = Scene("line", (Axis("x", 0.0, 0.1),), (Phalanx("index", (0.0,)),))
MS = 1_000_000


def pair(stamp_ms: int, x: float | None = 0.05, status: int = 0) -> Pair:
    strain = np.full(8, float(stamp_ms))
    position = None if x is None else np.array([x])
    return Pair(stamp_ms * MS, position, (strain, np.array([status], dtype=np.uint8)))


class Session(SweepRecorder):
    """A recorder with the session whose pairs it takes; times in ms."""

    def __init__(self, store: ScanWriter, detector: SweepDetector | None = None) -> None:
        super().__init__(store, detector is not None, Coverage(SCENE))
        self.session = streams.Session(SCENE.axes, max_gap_s=0.0, detector=detector)

    def begin(self, after_ms: int) -> int:
        number = self.start(0, after_ms * MS)
        self.session.mark(0, after_ms * MS, number)
        return number

    def stop(self, until_ms: int) -> OpenSweep:
        self.session.mark(0, until_ms * MS, NO_SWEEP)
        return self.end(0, until_ms * MS)

    def record(self, *pairs: Pair) -> None:
        for each in pairs:
            if each.position is not None:
                self.session.add_pose(each.stamp_ns, each.position)
            self.session.add_strain(each.stamp_ns, each.measurement)
        self.take(self.session.finish())


@pytest.fixture
def store(tmp_path):
    with ScanWriter(tmp_path / "scan", SCENE) as store:
        yield store


def recorded(store: ScanWriter) -> dict[int, list[int]]:
    return {s.number: [int(stamp // MS) for stamp in s.stamp_ns] for s in store.recording().sweeps}


def test_a_sweep_holds_the_samples_between_its_stamps(store):
    recorder = Session(store)
    recorder.record(pair(1))
    assert recorder.begin(2) == 1
    assert recorder.is_active
    recorder.record(pair(2), pair(3), pair(4))
    sweep = recorder.stop(5)
    assert not recorder.is_active
    recorder.settle((0, 4 * MS))
    assert not recorder.is_complete(sweep)
    recorder.record(pair(5), pair(6))
    recorder.settle((0, 6 * MS))
    assert recorder.is_complete(sweep)
    assert (sweep.number, sweep.pairs) == (1, 3)
    assert recorded(store) == {1: [3, 4, 5]}
    assert store.recording().sweeps[0].ending == "ended"


def test_waiting_samples_stay_in_their_sweep(store):
    recorder = Session(store)
    recorder.begin(0)
    recorder.record(pair(1))
    recorder.stop(3)
    assert recorder.begin(3) == 2
    recorder.record(pair(2), pair(3), pair(4))
    recorder.close()
    assert recorded(store) == {1: [1, 2, 3], 2: [4]}
    assert [sweep.ending for sweep in store.recording().sweeps] == ["ended", "ended"]


def test_gaps_and_skipped_samples_are_counted(store):
    recorder = Session(store)
    recorder.record(pair(0, None))
    recorder.begin(0)
    recorder.record(pair(1, None), pair(2, 0.05, MISSING), pair(3, 0.2), pair(4))
    recorder.stop(4)
    recorder.begin(4)
    recorder.record(pair(5, None), pair(6))
    recorder.close()
    assert (recorder.gaps, recorder.skipped) == (2, 2)
    assert [(len(sweep), sweep.gaps, sweep.skipped) for sweep in store.recording().sweeps] == [
        (1, 1, 2),
        (1, 1, 0),
    ]


def test_start_and_end_must_alternate(store):
    recorder = Session(store)
    with pytest.raises(ScanError, match="end sweep: expected an active sweep, found none"):
        recorder.stop(0)
    recorder.begin(0)
    with pytest.raises(ScanError, match="start sweep: expected no active sweep, found sweep 1"):
        recorder.begin(0)


def test_a_recorder_continues_the_scan(store):
    recorder = Session(store)
    recorder.begin(0)
    recorder.record(pair(1), pair(2))
    recorder.close()
    coverage = Coverage(SCENE)
    recorder = SweepRecorder(store, False, coverage)
    assert (recorder.number, recorder.sweeps, recorder.pairs) == (1, 1, 2)
    assert coverage.fraction > 0.0


def remove(file):
    file.unlink()


def remove_folder(file):
    shutil.rmtree(file.parent)


def move_folder(file):
    file.parent.rename(file.parent.with_name("moved"))


def cut_short(file):
    os.truncate(file, file.stat().st_size - 30)


def replace_by_copy(file):
    file.write_bytes(bytes(file.rename(file.with_name("old.npy")).read_bytes()))


@pytest.mark.parametrize("harm", [remove, remove_folder, move_folder, cut_short, replace_by_copy])
@pytest.mark.parametrize("has_ended", [False, True])
def test_a_sweep_that_is_no_longer_in_the_scan_is_written_again(store, harm, has_ended):
    recorder = Session(store)
    recorder.begin(0)
    recorder.record(pair(1), pair(2, None), pair(3))
    recorder.settle((0, 3 * MS))
    (file,) = store.path.glob("sweep_*.npy")
    harm(file)
    recorder.record(pair(4))
    if has_ended:
        recorder.stop(5)
    with pytest.raises(
        ScanError, match=r"1\.npy: expected .* removed or cut short; its 3 pairs are in sweep"
    ):
        recorder.settle((0, 5 * MS))
    assert not recorder.is_active
    (rescued,) = [sweep for sweep in store.recording().sweeps if len(sweep) == 3]
    assert ([stamp // MS for stamp in rescued.stamp_ns], rescued.gaps) == ([1, 3, 4], 1)
    assert recorder.pairs == len(store.recording())
    assert recorder.begin(5) == recorder.number > rescued.number
    recorder.record(pair(6))
    recorder.close()
    assert recorded(store)[recorder.number] == [6]


@pytest.mark.parametrize("is_open", [True, False])
def test_a_scene_that_is_removed_is_written_again(store, is_open):
    recorder = Session(store)
    if is_open:
        recorder.begin(0)
        recorder.record(pair(1))
    (store.path / "scene.yaml").unlink()
    if not is_open:
        recorder.begin(0)
        recorder.record(pair(1))
    recorder.settle((0, 1 * MS))
    assert len(ScanFolder(store.path).recording()) == 1


def test_a_scan_that_cannot_be_made_again_loses_only_the_sweep(store):
    recorder = Session(store)
    recorder.begin(0)
    recorder.record(pair(1))
    shutil.rmtree(store.path)
    store.path.touch()
    with pytest.raises(ScanError, match=r"removed or cut short; .*scan: could not be read"):
        recorder.settle((0, 1 * MS))
    store.path.unlink()
    recorder.begin(1)
    recorder.record(pair(2))
    recorder.close()
    assert recorded(store) == {1: [2]}
    with pytest.raises(ScanError, match="another process is writing it"):
        ScanWriter(store.path, SCENE)


def test_a_detected_sweep_is_opened_again_after_a_failed_write(store):
    recorder = Session(store, SweepDetector(SCENE.axes))
    pairs = [pair(ms, 0.01 + 5e-5 * ms) for ms in range(0, 900, 10)]
    recorder.record(*pairs[:40])
    number = recorder.number
    with full_disk(100), pytest.raises(ScanError, match="could not be written"):
        recorder.settle((0, 0))
    recorder.record(*pairs[40:])
    recorder.close()
    assert recorder.number == number + 1
    assert recorded(store)[number + 1] == list(range(400, 900, 10))


def test_a_full_disk_abandons_only_the_sweep(store):
    recorder = Session(store)
    recorder.begin(0)
    recorder.record(pair(1))
    recorder.settle((0, 0))
    (file,) = store.path.glob("sweep_*.npy")
    with full_disk(file.stat().st_size + 50):  # of the next pair, a part is written
        recorder.record(pair(2))
        with pytest.raises(ScanError, match=r"sweep_0001\.npy: could not be written"):
            recorder.settle((0, 0))
    assert not recorder.is_active
    assert recorder.begin(2) == 2
    recorder.record(pair(3))
    recorder.close()
    assert recorded(store) == {1: [1], 2: [3]}
