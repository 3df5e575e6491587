"""Sweeps hold the samples between two stamps, even if their poses arrive late."""

import numpy as np
import pytest
from support.disk import full_disk

from tactile_localizer.core.geometry.synchronization import Pair
from tactile_localizer.core.scan.coverage import Coverage
from tactile_localizer.core.scan.sweep_detector import SweepDetector
from tactile_localizer.errors import ScanError
from tactile_localizer.io.scans.recorder import SweepRecorder
from tactile_localizer.io.scans.writer import ScanWriter
from tactile_localizer.io.status import MISSING
from tactile_localizer.scene import Axis, Phalanx, Scene

SCENE = Scene("line", (Axis("x", 0.0, 0.1),), (Phalanx("index", (0.0,)),))
MS = 1_000_000


def pair(stamp_ms: int, x: float | None = 0.05, status: int = 0) -> Pair:
    strain = np.full(8, float(stamp_ms))
    position = None if x is None else np.array([x])
    return Pair(stamp_ms * MS, position, (strain, np.array([status], dtype=np.uint8)))


@pytest.fixture
def store(tmp_path):
    with ScanWriter(tmp_path / "scan", SCENE) as store:
        yield store


def recorder_of(store: ScanWriter) -> SweepRecorder:
    return SweepRecorder(store, None, Coverage(SCENE))


def recorded(store: ScanWriter) -> dict[int, list[int]]:
    return {s.number: [int(stamp // MS) for stamp in s.stamp_ns] for s in store.recording().sweeps}


def test_a_sweep_holds_the_samples_between_its_stamps(store):
    recorder = recorder_of(store)
    recorder.take([pair(1)])
    assert recorder.start(2 * MS) == 1
    assert recorder.is_active
    recorder.take([pair(2), pair(3), pair(4)])
    assert recorder.end(5 * MS) == 1
    assert not recorder.is_active
    recorder.settle(waiting_ns=5 * MS)
    recorder.take([pair(5), pair(6)])
    recorder.settle(waiting_ns=None)
    assert recorded(store) == {1: [3, 4, 5]}
    assert store.recording().sweeps[0].ending == "ended"


def test_waiting_samples_stay_in_their_sweep(store):
    recorder = recorder_of(store)
    recorder.start(0)
    recorder.take([pair(1)])
    recorder.end(3 * MS)
    assert recorder.start(3 * MS) == 2
    recorder.take([pair(2), pair(3), pair(4)])
    recorder.close()
    assert recorded(store) == {1: [1, 2, 3], 2: [4]}
    assert [sweep.ending for sweep in store.recording().sweeps] == ["ended", "ended"]


def test_gaps_and_skipped_samples_are_counted(store):
    recorder = recorder_of(store)
    recorder.take([pair(0, None)])
    recorder.start(0)
    recorder.take([pair(1, None), pair(2, 0.05, MISSING), pair(3, 0.2), pair(4)])
    recorder.end(4 * MS)
    recorder.start(4 * MS)
    recorder.take([pair(5, None), pair(6)])
    recorder.close()
    assert (recorder.gaps, recorder.skipped) == (2, 2)
    assert [(len(sweep), sweep.gaps, sweep.skipped) for sweep in store.recording().sweeps] == [
        (1, 1, 2),
        (1, 1, 0),
    ]


def test_start_and_end_must_alternate(store):
    recorder = recorder_of(store)
    with pytest.raises(ScanError, match="end sweep: expected an active sweep, found none"):
        recorder.end(0)
    recorder.start(0)
    with pytest.raises(ScanError, match="start sweep: expected no active sweep, found sweep 1"):
        recorder.start(0)


def test_a_backward_jump_starts_another_sweep(store):
    recorder = recorder_of(store)
    recorder.start(1000 * MS)
    recorder.take([pair(1001), pair(1002)])
    recorder.take([pair(1), pair(2)])
    assert recorder.number == 2
    recorder.close()
    assert recorded(store) == {1: [1001, 1002], 2: [1, 2]}


def test_a_recorder_continues_the_scan(store):
    recorder = recorder_of(store)
    recorder.start(0)
    recorder.take([pair(1), pair(2)])
    recorder.close()
    coverage = Coverage(SCENE)
    recorder = SweepRecorder(store, None, coverage)
    assert (recorder.number, recorder.sweeps, recorder.pairs) == (1, 1, 2)
    assert coverage.fraction > 0.0


def test_detection_begins_anew_after_a_backward_jump(store):
    recorder = SweepRecorder(store, SweepDetector(SCENE.axes), Coverage(SCENE))
    detector, moving = SweepDetector(SCENE.axes), []
    for speed in (5e-5, -5e-5):  # m/ms
        pairs = [pair(ms, 0.05 + speed * min(max(0, ms - 300), 600)) for ms in range(0, 3000, 10)]
        recorder.take(pairs)
        detector.reset()
        moving.append([one.stamp_ns // MS for one in pairs if detector.update(one.stamp_ns, one.position)])
    recorder.close()
    assert list(recorded(store).values()) == moving
    assert min(map(len, moving)) > 50


def test_a_full_disk_abandons_only_the_sweep(store):
    recorder = recorder_of(store)
    recorder.start(0)
    recorder.take([pair(1)])
    recorder.settle(None)
    (file,) = store.path.glob("sweep_*.npy")
    with full_disk(file.stat().st_size + 50):  # of the next pair, a part is written
        recorder.take([pair(2)])
        with pytest.raises(ScanError, match=r"sweep_0001\.npy: could not be written"):
            recorder.settle(None)
    assert not recorder.is_active
    assert recorder.start(2 * MS) == 2
    recorder.take([pair(3)])
    recorder.close()
    assert recorded(store) == {1: [1], 2: [3]}
