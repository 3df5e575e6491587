"""The simulated hand as an installed process: poses over DDS, frames on the bus, services."""

import os
import signal
import time

import can
import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Bool
from support.diagnostics import status_of
from support.hand import stamp_of

from tactile_localizer.io.can.bus import BusSettings, open_bus
from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol
from tactile_localizer.msg import StrainVectors
from tactile_localizer.resources import resource_path
from tactile_localizer.sim import simulate_sweep
from tactile_localizer.sim.scan import sweep_plan

SPEED, CELL_HZ, POSE_HZ = 10.0, 5.0, 20.0
"""So few frames that those of two seconds fit into the receive buffer of a test that is put aside."""


@pytest.fixture
def start(node_process, bus):
    """Start the simulator at high speed on a separate bus."""

    def start(**parameters):
        rates = {"speed": SPEED, "load_cell_rate_hz": CELL_HZ, "pose_rate_hz": POSE_HZ}
        return node_process("simulator_node", {**rates, **bus, **parameters})

    return start


@pytest.fixture
def frames(simulated_can):
    """A buffer of the frames on the bus."""
    options = {"port": simulated_can["port"]}
    bus = open_bus(
        BusSettings(simulated_can["interface"], simulated_can["channel"], options, receive_buffer=1 << 18)
    )
    buffer = can.BufferedReader()
    notifier = can.Notifier(bus, [buffer], timeout=0.1)
    yield buffer
    notifier.stop()
    bus.shutdown()


class Hand:
    """Topics and services of the simulator."""

    def __init__(self, probe):
        self._probe = probe
        self.poses = probe.listen(PoseStamped, "palm_pose", 1000)
        self.truth = probe.listen(PoseStamped, "tactile_simulator/ground_truth", 1000)
        self.active = probe.listen(Bool, "tactile_simulator/sweep_active", probe.latched)

    def call(self, service):
        return self._probe.trigger(f"tactile_simulator/{service}")

    def do_sweep(self):
        """Message of the service, and poses and ground truth of the sweep, (n, 2) each."""
        self.wait_for_present()
        first = len(self.poses), len(self.truth)
        self.active.clear()
        report = self.call("sweep").message
        self._probe.until(lambda: any(message.data for message in self.active), "the sweep's start")
        self._probe.until(lambda: not self.active[-1].data, "the sweep's end")
        self.wait_for_present()
        return report, xy(self.poses[first[0] :]), xy(self.truth[first[1] :])

    def wait_for_present(self):
        """Receive all poses and ground truth published so far."""
        now_ns = time.time_ns()
        for messages in (self.poses, self.truth):
            self._probe.until(
                lambda messages=messages: messages and stamp_of(messages[-1]) > now_ns, "the present"
            )


@pytest.fixture
def hand(probe):
    return Hand(probe)


def xy(messages):
    return np.array([[m.pose.position.x, m.pose.position.y] for m in messages])


def drain(buffer):
    messages = []
    while (message := buffer.get_message(0)) is not None:
        messages.append(message)
    return messages


def test_frames_carry_the_strain_of_a_sweep_and_poses_a_constant_offset(start, hand, frames):
    start(mode="localize")
    hand.call("prepare")
    drain(frames)
    report, poses, truth = hand.do_sweep()
    assert report == "localize: sweep 0"
    n = min(len(poses), len(truth))
    off = np.median(poses[-n:] - truth[-n:], axis=0)
    assert np.max(np.abs(off)) > 0.01
    np.testing.assert_allclose(np.ptp(poses, axis=0)[0], np.ptp(truth, axis=0)[0], atol=4e-3)
    protocol = LoadCellProtocol(resource_path("config/loadcells.dbc"), ("index", "middle"))
    received = drain(frames)
    assert {protocol.classify(frame)[0] for frame in received} == {FrameKind.DATA}
    others = bytes(protocol.size - 8)
    of_index = [frame for frame in received if protocol.classify(frame)[1] == 0]
    start_at, end = sweep_plan("test", 0, 1)
    felt = simulate_sweep("bump", 1, 0, "test", start=start_at, end=end, rate=CELL_HZ).strain[:, :4]
    sent = np.array([protocol.decode(frame.data + others)[0][:4] for frame in of_index])
    apart = np.max(np.abs(sent[:, None] - felt), axis=2)
    assert np.max(np.min(apart, axis=1)[1:]) < 0.02  # the first can be of before the sweep
    assert np.max(np.min(apart, axis=0)[1:-1]) < 1e-3  # no sample is left out


def test_a_busy_machine_slows_the_hand_down_and_drops_nothing(
    start, node_process, bus, hand, probe, tmp_path
):
    simulator = start(speed=2.0, load_cell_rate_hz=200.0, pose_rate_hz=20.0)
    patient = {"receive_buffer": 1 << 17, "period_s": 1.0, "max_age_s": 60.0}
    driver = node_process("driver_node", {**bus, **patient, "tare_file": tmp_path / "tare.yaml"})
    arrays = probe.diagnostics()

    def counted(name):
        return status_of(arrays, f"tactile_driver: {name}")[2]

    def received(more):
        arrays.clear()
        before = len(hand.poses)
        probe.until(lambda: len(hand.poses) > before + more and counted("index"), "poses and diagnostics")

    probe.until(lambda: int(counted("index").get("samples", 0)) > 100, "samples")
    assert hand.call("sweep").success
    probe.until(lambda: hand.active and hand.active[-1].data, "the sweep")
    first = len(hand.poses)
    for frozen in (simulator, driver):
        os.kill(frozen.pid, signal.SIGSTOP)
        # The hand would send 480 frames, of which the driver's queue holds 160. A stop of half a period would
        # divide the cycle that is being sent.
        time.sleep(0.3)
        os.kill(frozen.pid, signal.SIGCONT)
        received(20)
    assert counted("CAN bus")["queue_drops"] == counted("CAN bus")["frames_late"] == "0"
    # Frames of a cycle that is divided all the same are in none.
    assert sum(int(counted(name)["drops"]) for name in ("index", "middle")) < 20
    hand.wait_for_present()
    stamps_ns = np.array([stamp_of(pose) for pose in hand.poses[first:]])
    assert np.all(np.diff(stamps_ns) > 0)
    paused = np.diff(stamps_ns) > 0.2e9
    moved = np.linalg.norm(np.diff(xy(hand.poses[first:]), axis=0), axis=1)
    last = np.flatnonzero(moved)[-1]  # before the end of the sweep
    # It moves 0.34 mm between two poses, however late they are, and would move 3 mm in a pause. Not in every
    # pause, because poses can be lost on their way to a subscriber that gets no CPU.
    assert np.min(moved[:last][paused[:last]]) < 1e-3, "a hand that waits does not move"


def test_cycles_that_a_driver_lost_do_not_hold_the_hand_up_for_ever(start, frames, probe):
    """A driver that waits for what follows its newest cycle publishes that one each second."""
    start(speed=1.0, load_cell_rate_hz=100.0)
    strain = probe.publisher(StrainVectors, "strain", probe.best_effort)
    probe.known_to("tactile_simulator")
    strain.publish(StrainVectors())
    probe.until(lambda: not sent_in(frames, 0.5), "a hand that waits")

    def published_and_sent():
        strain.publish(StrainVectors())
        return sent_in(frames, 1.0)

    probe.until(lambda: published_and_sent() > 40, "more than a cycle for each that is published")


def sent_in(frames, duration_s):
    """Number of frames within a time, s."""
    drain(frames)
    time.sleep(duration_s)
    return len(drain(frames))


def test_a_sweep_is_prepared_excludes_another_and_can_be_made_faster(start, hand, probe):
    start(speed=0.3)  # a sweep of 25 s
    assert hand.call("sweep").success
    probe.until(lambda: hand.active and hand.active[-1].data, "the sweep's start")
    for service in ("prepare", "sweep"):
        answer = hand.call(service)
        assert not answer.success
        assert "sweeping" in answer.message
    assert probe.set_parameter("tactile_simulator", "speed", 20.0).successful
    probe.until(lambda: not hand.active[-1].data, "the sweep's end")


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"feature": "button"}, "expected one of bump, snap, grommet, seam, none, got 'button'"),
        ({"fault.silent": ["thumb"]}, "fault.silent: expected one of index, middle, got 'thumb'"),
    ],
)
def test_an_invalid_parameter_is_rejected_in_one_line(refusal, parameters, message):
    (line,) = refusal("simulator_node", parameters)
    assert message in line
