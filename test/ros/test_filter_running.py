"""One running filter: strain and poses in, estimates out.

The node is started once; each test resets the belief and repeats the sweep at a later time.
"""

import re
import time

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Bool
from std_srvs.srv import Empty
from support.filter import CELL, Filter, initial_pose
from support.hand import SlidingHand, stamp_of
from support.probe import Probe
from support.processes import Process, node_command
from support.sweeps import unseen_sweep
from visualization_msgs.msg import MarkerArray


@pytest.fixture(scope="module")
def running(scan_file):
    parameters = {"scan_file": scan_file, **CELL, "shown_particles": 50, "particles_rate_hz": 5.0}
    process, probe = Process(node_command("filter_node", parameters), forked=True), Probe("watching")
    try:
        yield Filter(process, probe, SlidingHand(probe, unseen_sweep()))
    finally:
        probe.close()
        process.kill()
        print(process.output)


@pytest.fixture
def node(running):
    assert running.process.running
    running.restart()
    return running


@pytest.fixture
def probe(running):
    return running.probe


def slide_until(node, condition, what, samples=1, **how):
    """Slide, ``samples`` at once and at a pace at which the sweep lasts, until a condition holds."""
    due_s = time.monotonic()

    def given():
        nonlocal due_s
        if time.monotonic() >= due_s and node.hand.next + samples < len(node.hand.strain_ns):
            due_s = time.monotonic() + 0.05 * samples**0.5
            node.hand.slide(samples, **how)
        return condition()

    return node.probe.until(given, what)


def slide_until_reason(node, reason, samples=1, **how):
    """Slide until a posterior gives this reason (regular expression)."""
    return slide_until(
        node,
        lambda: next((one for one in node.posteriors if re.match(reason, one.reason)), None),
        reason,
        samples,
        **how,
    )


MISSING = (
    r"no strain on /strain \(1 publisher\) and no palm_pose on /palm_pose \(1 publisher\), no estimate for"
)


def test_missing_inputs_are_reported(node, probe):
    waiting = probe.until(
        lambda: [one for one in node.posteriors if re.match(f"stale: {MISSING}", one.reason)], "the reason"
    )[-1]
    assert waiting.stale
    assert not waiting.converged
    probe.until(lambda: re.match(MISSING, node.status("inputs")[1]), "the missing inputs")
    assert node.status("inputs")[0] == b"\x02"
    assert node.status("belief")[0] == b"\x03", "stale"
    node.slide(10)
    assert not node.posteriors[-1].stale


def test_pose_flag_and_particles_agree_with_the_posterior(node, probe):
    poses = probe.listen(PoseWithCovarianceStamped, "tactile_filter/pose", 1000)
    flags = probe.listen(Bool, "tactile_filter/converged", 1000)
    clouds = probe.listen(PointCloud2, "tactile_filter/particles", 100)
    markers = probe.listen(MarkerArray, "tactile_filter/markers", 100)
    probe.known_to("tactile_filter")
    node.slide(100)
    posterior = node.fresh()[-1]
    probe.until(lambda: poses and stamp_of(poses[-1]) == stamp_of(posterior), "its pose")
    probe.until(
        lambda: [flag.data for flag in flags] == [one.converged for one in node.posteriors][-len(flags) :],
        "a flag for each",
    )
    pose = poses[-1]
    np.testing.assert_allclose([pose.pose.pose.position.x, pose.pose.pose.position.y], posterior.mean)
    covariance = np.reshape(pose.pose.covariance, (6, 6))
    np.testing.assert_allclose(covariance[:2, :2].ravel(), posterior.covariance)
    np.testing.assert_array_equal(covariance[2:], np.eye(6)[2:] * 1e6)
    assert flags[-1].data == posterior.converged
    assert 15 <= len(clouds) <= 25, "4 s of stamps at 5 Hz"
    assert [field.name for field in clouds[-1].fields] == ["x", "y", "z", "weight"]
    points = np.frombuffer(clouds[-1].data, "<f4").reshape(-1, 4)
    assert len(points) == clouds[-1].width <= 50
    assert points[:, 3].sum() == pytest.approx(1.0)
    near = next(m for m in node.fresh() if stamp_of(m) == stamp_of(clouds[-1]))
    np.testing.assert_allclose(np.average(points[:, :2], axis=0, weights=points[:, 3]), near.mean, atol=2e-3)
    pads = markers[-1].markers[0]
    assert len(pads.points) == 2
    assert pads.points[0].y - pads.points[1].y == pytest.approx(0.0254)
    reason = markers[-1].markers[2]
    assert reason.text
    assert reason.pose.position.y > 0.0508, "the text is above the map, not on the hand"


def test_lost_strain_vectors_are_counted(node, probe):
    lost = node.count("strain_vectors_lost_in_transport")
    node.slide(10)
    node.hand.send_strain(10, sequence=[13, 13])  # numbers 10 to 12 were lost
    node.hand.next += 1
    node.slide(5, sequence=[14, 14])
    node.wait_for_count("strain_vectors_lost_in_transport", lost + 3)
    reports = [
        s.message for array in node.diagnostics for s in array.status if s.name == "tactile_filter: inputs"
    ]
    assert any("3 strain vectors lost" in message for message in reports)


def test_a_spike_names_its_gauge(node):
    node.slide(20)
    spoiled = node.hand.sweep.strain[20].tolist()
    spoiled[2] += 1.0
    node.hand.slide(1, strain=False)
    node.hand.send_strain(20, strain=spoiled)
    node.slide(20)
    reports = lambda: [s.message for array in node.diagnostics for s in array.status]  # noqa: E731
    node.probe.until(lambda: any("1 spikes in index_3" in message for message in reports()), "the gauge")


def test_without_poses_the_estimate_is_stale(node, probe):
    flags = probe.listen(Bool, "tactile_filter/converged", 1000)
    probe.known_to("tactile_filter")
    node.slide(100)
    last = node.fresh()[-1]
    stale = slide_until_reason(
        node, r"stale: no palm_pose on /palm_pose \(1 publisher\), no estimate", poses=False
    )
    assert stale.stale
    assert (list(stale.mean), stamp_of(stale)) == (list(last.mean), stamp_of(last))
    assert not stale.converged
    probe.until(lambda: flags and not flags[-1].data, "the flag")
    probe.until(lambda: node.status("inputs")[0] == b"\x02", "the error level")
    assert "palm" in node.status("inputs")[1]
    node.slide(10)
    assert not node.posteriors[-1].stale
    assert node.status("belief")[0] in (b"\x00", b"\x03")


def test_a_late_subscriber_gets_the_last_pose(node, probe):
    node.slide(30)
    poses = probe.listen(PoseWithCovarianceStamped, "tactile_filter/pose", probe.latched)
    (pose,) = probe.until(lambda: poses, "the pose")
    near = next(one for one in node.fresh() if stamp_of(one) == stamp_of(pose))
    assert stamp_of(node.fresh()[-1]) - stamp_of(near) <= 200_000_000, "the period of ~/particles"
    np.testing.assert_allclose([pose.pose.pose.position.x, pose.pose.pose.position.y], near.mean)


def test_poses_that_are_too_far_apart_are_the_reason(node, monkeypatch):
    def send_some(k):
        if k % 10 == 0:  # 0.4 s by the stamps
            send(k)

    send = node.hand.send_pose
    monkeypatch.setattr(node.hand, "send_pose", send_some)
    slide_until_reason(
        node,
        r"stale: palm_pose: the poses are 0\.4 s apart, .* at most 0\.1 s: max_gap_s 0\.6 is right",
        samples=10,
    )


def test_without_strain_the_estimate_is_stale(node, probe):
    node.slide(20)
    node.hand.slide(20, strain=False)
    probe.until(lambda: node.posteriors[-1].stale, "stale")
    assert "no strain" in node.posteriors[-1].reason
    held = len(node.posteriors)
    probe.until(lambda: len(node.posteriors) >= held + 2, "repetitions for late subscribers")
    assert {tuple(m.mean) for m in node.posteriors[held:]} == {tuple(node.fresh()[-1].mean)}


@pytest.mark.parametrize(("ahead_s", "what"), [(3600, "ahead of"), (-3600, "behind")])
def test_poses_with_the_stamps_of_another_clock_are_reported(node, probe, monkeypatch, ahead_s, what):
    """After a reset too, which ignores the strain before it."""
    monkeypatch.setattr(node.hand, "pose_ns", node.hand.pose_ns + ahead_s * 1_000_000_000)
    node.hand.slide(10)
    probe.call(Empty, "tactile_filter/reinitialize_global_localization")
    reported = rf"palm_pose: stamps are 3(600|599)\.\d\d s {what} the strain"
    slide_until(node, lambda: re.search(reported, node.status("inputs")[1]), "the report")
    probe.until(lambda: node.status("inputs")[0] == b"\x02", "the error level")
    assert not node.fresh()


def test_poses_that_are_ahead_are_not_taken_for_missing_strain(node, monkeypatch):
    node.slide(20)
    monkeypatch.setattr(node.hand, "pose_ns", node.hand.pose_ns + 800_000_000)
    slide_until_reason(node, r"stale: palm_pose: stamps are 0\.\d\d s ahead of the strain")


def test_zero_stamps_are_ignored(node):
    node.slide(5)
    seen, jumps = len(node.fresh()), node.count("backward_jumps_of_the_stamps")
    unstamped = node.count("invalid_messages_on_strain")
    offset_ns, node.hand.offset_ns = node.hand.offset_ns, -int(node.hand.strain_ns[5])
    node.hand.send_strain(5)
    node.hand.offset_ns = offset_ns
    node.slide(5)
    assert len(node.fresh()) == seen + 5
    assert node.count("backward_jumps_of_the_stamps") == jumps, "a stopped clock is no backward jump"
    assert node.count("invalid_messages_on_strain") == unstamped + 1


def test_the_belief_can_be_reset(node, probe):
    node.slide(180)
    assert node.fresh()[-1].travel > 0.03
    probe.call(Empty, "tactile_filter/reinitialize_global_localization")
    node.slide(4)
    again = node.fresh()[-1]
    assert again.travel < 0.005
    assert again.covariance_trace > 1e-4


def test_an_initial_pose_seeds_the_belief(node, probe):
    node.slide(20)
    publisher = probe.publisher(PoseWithCovarianceStamped, "tactile_filter/initial_pose")
    printed = len(node.process.lines)
    publisher.publish(initial_pose(0.01, 0.04, 1e-6))
    node.process.wait_for_line("belief seeded", after=printed)
    node.slide(1)
    np.testing.assert_allclose(node.means()[-1], [0.01, 0.04], atol=2e-3)
    assert node.fresh()[-1].covariance_trace < 1e-5


def test_invalid_seeds_keep_the_belief(node, probe):
    invalid = node.count("invalid_messages_on_initial_pose")
    node.slide(50)
    publisher = probe.publisher(PoseWithCovarianceStamped, "tactile_filter/initial_pose", 10)
    printed = len(node.process.lines)
    publisher.publish(initial_pose(0.01, 0.04, 1e-6, "map"))
    node.process.wait_for_line("initial_pose: .*frame 'map'", after=printed)
    for pose in ((0.2, 0.04, 1e-6), (np.nan, 0.04, 1e-6), (0.01, 0.04, -1.0), (0.01, 0.04, np.nan)):
        publisher.publish(initial_pose(*pose))
    node.wait_for_count("invalid_messages_on_initial_pose", invalid + 5)
    travel = node.fresh()[-1].travel
    node.slide(5)
    assert node.fresh()[-1].travel > travel
    node.hand.slide(40, poses=False)
    probe.until(lambda: node.posteriors[-1].stale, "stale")
    assert "initial_pose" not in node.posteriors[-1].reason, "the seed is not why there is no estimate"
