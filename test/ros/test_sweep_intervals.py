"""A sweep is an interval of time: what is stamped within it belongs to it, whenever it arrives."""

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from functools import partial

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from support import bags
from support.bags import MS, SCENE
from support.hand import DEEP_QUEUE
from support.waiting import Deadline, wait_until

from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.msg import StrainVectors
from tactile_localizer.ros.base.child_process import end_with_parent
from tactile_localizer.streams.synchronization import interpolate_poses

PHALANGES = ("index", "middle")
NODE = "tactile_mapping"
QUEUES = {**DEEP_QUEUE, "queue_depth": 10_000, "patience_s": 30.0}
"""As deep as those of the publishers: a node that gets no processor for half a minute loses nothing."""


@contextmanager
def busy_processes(count):
    """Context in which processes use all CPUs."""
    command = [sys.executable, "-c", "while True: pass"]
    busy = [subprocess.Popen(command, preexec_fn=end_with_parent) for _ in range(count)]  # noqa: PLW1509
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


class Stream(threading.Thread):
    """Publishes strain and poses of the present from a thread, and keeps them.

    Parameters
    ----------
    probe : creates the publishers
    delay_s : time from the stamp of a message to its publication
    clock_s : time of the clock of the stamps ahead of this machine's
    """

    STRAIN_MS, POSE_MS = 20, 4

    def __init__(self, probe, delay_s=0.0, clock_s=0.0):
        super().__init__(daemon=True)
        self._delay_s, self._ahead_ns = delay_s, round(clock_s * 1e9)
        kinds = {"strain": StrainVectors, "palm_pose": PoseStamped}
        self._publishers = {topic: probe.publisher(kind, topic, 10_000) for topic, kind in kinds.items()}
        probe.known_to(NODE)
        self.stamps = {"strain": [], "palm_pose": []}
        self._ended = threading.Event()
        self.start()

    def now_ns(self):
        """Time of the clock of the stamps."""
        return time.time_ns() + self._ahead_ns

    def run(self):
        begin_ns, sent_ms = self.now_ns() // MS * MS, 0
        while not self._ended.wait(0.005):
            until_ms = (self.now_ns() - begin_ns) // MS - round(1000 * self._delay_s)
            for at_ms in range(sent_ms, until_ms):
                if at_ms % self.STRAIN_MS == 1:
                    self._publish("strain", begin_ns + at_ms * MS)
                if at_ms % self.POSE_MS == 0:
                    self._publish("palm_pose", begin_ns + at_ms * MS)
            sent_ms = max(sent_ms, until_ms)

    def _publish(self, topic, stamp_ns):
        if topic == "strain":
            count = np.full(2, len(self.stamps[topic]), dtype=np.uint32)
            message = bags.strain(1, PHALANGES, sequence=count)
        else:
            message = bags.pose(1, "material", float(place_at(np.array([stamp_ns]))[0, 0]), 0.02)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
        self._publishers[topic].publish(bytes(bags.STORE.serialize_cdr(message, bags.TYPES[topic])))
        self.stamps[topic].append(stamp_ns)

    def close(self):
        self._ended.set()
        self.join()


def place_at(stamp_ns):
    """Positions (n, 2) of the palm at stamps, m."""
    x = 0.025 + 0.02 * np.sin((stamp_ns % (10 * 10**9)) * 2e-9 * np.pi / 5)
    return np.column_stack([x, np.full(len(x), 0.02)])


def recorded(files):
    return ScanFolder(files["scan_file"]).recording().sweeps


def require_as_offline(sweep, stream):
    """Require that a sweep has the pairs of a recording of the stream, to the last bit."""
    stamp_ns, pose_ns = (np.array(stream.stamps[topic]) for topic in ("strain", "palm_pose"))
    positions, found = interpolate_poses(SCENE.axes, pose_ns, place_at(pose_ns), stamp_ns)
    rows = found & (stamp_ns >= sweep.stamp_ns[0]) & (stamp_ns <= sweep.stamp_ns[-1])
    np.testing.assert_array_equal(sweep.stamp_ns, stamp_ns[rows])
    np.testing.assert_array_equal(sweep.position, positions[rows])


@pytest.mark.parametrize(
    ("delay_s", "clock_s", "is_busy"),
    [(0.3, 0.0, False), (0.0, -3600.0, False), (0.0, 0.02, False), (0.0, 0.0, True)],
    ids=["late", "another clock", "ahead", "a busy node"],
)
def test_a_sweep_is_an_interval_of_the_stamps(node_process, probe, files, delay_s, clock_s, is_busy):
    parameters = {**files, **QUEUES}
    node = node_process("mapping_node", parameters)
    stream = Stream(probe, delay_s, clock_s)
    try:
        wait_until(lambda: len(stream.stamps["strain"]) > 30, "strain")
        before_ns = stream.now_ns()
        assert probe.trigger(f"{NODE}/start_sweep").success
        started_ns = stream.now_ns()
        if is_busy:
            os.kill(node.pid, signal.SIGSTOP)
        wait_until(lambda: stream.now_ns() > started_ns + 500 * MS, "half a second")
        os.kill(node.pid, signal.SIGCONT)
        until_ns = stream.now_ns()
        answer = probe.trigger(f"{NODE}/end_sweep")
        (sweep,) = recorded(files)
    finally:
        stream.close()
    assert answer.success
    assert answer.message == f"sweep 1 ended: {len(sweep)} pairs"
    period_ns = Stream.STRAIN_MS * MS
    # Of another clock only what has arrived is known, and on a busy machine that is not the newest.
    margin_ns = {0.0: 0, 0.02: 2 * period_ns, -3600.0: 10_000 * MS}[clock_s]
    assert before_ns - margin_ns < sweep.stamp_ns[0] < started_ns + 2 * period_ns
    assert until_ns - period_ns - margin_ns < sweep.stamp_ns[-1]
    require_as_offline(sweep, stream)


@pytest.mark.slow
def test_no_pair_is_lost_beside_six_busy_processes(node_process, probe, files):
    """With five poses for each strain vector, the poses must not fall behind."""
    two_periods_ns = 2 * Stream.STRAIN_MS * MS
    node_process("mapping_node", parameters={**files, **QUEUES})
    stream = Stream(probe)
    intervals = []
    try:
        with busy_processes(6):
            for _ in range(5):
                patience = Deadline("the strain of a sweep", QUEUES["patience_s"])
                assert probe.trigger(f"{NODE}/start_sweep").success
                begin_ns = stream.now_ns()
                wait_until(lambda begin_ns=begin_ns: stream.now_ns() > begin_ns + 10**9, "a second")
                intervals.append((begin_ns, stream.now_ns()))
                answer = probe.trigger(f"{NODE}/end_sweep")
                assert answer.success, answer.message
                assert "without a pose" not in answer.message
                if "no strain" in answer.message:
                    raise patience.failure()
    finally:
        stream.close()
    sweeps = recorded(files)
    assert len(sweeps) == 5
    for sweep, (begin_ns, end_ns) in zip(sweeps, intervals, strict=True):
        assert sweep.gaps == 0
        assert sweep.stamp_ns[0] < begin_ns + two_periods_ns
        assert sweep.stamp_ns[-1] > end_ns - two_periods_ns
        require_as_offline(sweep, stream)


def test_a_sweep_without_pairs_is_no_success(mapping):
    _, hand = mapping(patience_s=0.1)
    assert hand.service("start_sweep").success
    answer = hand.service("end_sweep")
    assert (answer.success, answer.message) == (False, "sweep 1 ended: no pairs")
    assert hand.service("start_sweep").success
    hand.slide(100, poses=False)
    hand.wait_for_stamp(100)
    answer = hand.service("end_sweep")
    assert (answer.success, answer.message) == (False, "sweep 2 ended: no pairs, 20 samples without a pose")


def test_a_sweep_ends_without_the_strain_that_never_comes(mapping, monkeypatch):
    monkeypatch.setattr("support.bags.START", time.time_ns())
    _, hand = mapping(patience_s=5.0)
    hand.x = lambda stamp_ms: bags.x_at(stamp_ms % 2000)  # on the sheet, however long the node takes
    hand.slide(20)
    assert hand.service("start_sweep").success
    hand.now_ms = (time.time_ns() - bags.START) // MS // 20 * 20 + 20
    hand.slide(200)
    time.sleep(0.7)
    answer = hand.service("end_sweep")
    assert answer.success
    assert ", no strain for its last " in answer.message
    assert hand.service("start_sweep").success


def test_what_a_busy_node_lost_is_not_blamed_on_a_clock(node_process, probe, files):
    process = node_process("mapping_node", parameters={**files, "queue_depth": 5})
    reports = probe.diagnostics()
    stream = Stream(probe)
    try:
        assert probe.trigger(f"{NODE}/start_sweep").success
        probe.until(lambda: any("recording" in text for text in messages(reports)), "a recording")
        for _ in range(5):  # a status at 1 Hz may come before the strain of the present, too
            os.kill(process.pid, signal.SIGSTOP)
            wait_until(partial(is_later, time.monotonic() + 1.5), "a while")
            os.kill(process.pid, signal.SIGCONT)
            resumed_s, count = time.monotonic(), len(reports)
            probe.until(lambda at=resumed_s + 5.0: is_later(at), "statuses")
            if any("this node is behind by" in text for text in messages(reports[count:])):
                break
        else:
            pytest.fail(f"expected the cause of lost strain, found {messages(reports)}")
    finally:
        stream.close()
    assert not any("stamps are" in text for text in messages(reports))


def test_implausible_motion_is_reported_while_it_is_recorded(mapping, probe):
    _, hand = mapping()
    reports = probe.diagnostics()
    hand.x = lambda stamp_ms: 0.02
    hand.service("start_sweep")
    probe.until(
        lambda: hand.slide(500) or any("does not change" in each for each in messages(reports)), "a note"
    )
    hand.service("end_sweep")
    reports.clear()
    probe.until(lambda: hand.slide(100) or reports, "a status")
    assert not any("does not change" in text for text in messages(reports)), "a hand may rest between sweeps"
    hand.x = lambda stamp_ms: 0.01 + 0.02 * (stamp_ms // 20 % 2)
    expected = "palm_pose: the position jumps by 20 mm within 20 ms and back"
    probe.until(lambda: hand.slide(500) or any(expected in each for each in messages(reports)), "a note")


def messages(reports):
    return [report.status[0].message for report in reports]


def is_later(time_s):
    return time.monotonic() > time_s
