"""The installed filter node from outside: strain and poses in, a belief out that is never made up."""

import dataclasses
import shutil

import numpy as np
import pytest
from support.sweeps import MEASUREMENT, START_NS, SlidingHand, scene_of, stamp_of, unseen_sweep, write_scan

from tactile_localizer.core.assembly import build_identifier, build_localizer
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.io.scan_store import ScanStore
from tactile_localizer.io.scene_file import save_scene
from tactile_localizer.scene import Axis, Phalanx, Scene

pytestmark = pytest.mark.ros

CELL = {"cell": 1.0}
"""Coarse enough to be quick."""
_QUEUE = 100
PAPER = {
    "filter": "particle",
    "particles": 75,
    "recovery": "constant",
    "random_particles": 10,
    "conditional": False,
    "resample_below": 1.0,
    "evaluation": "exact",
}


@pytest.fixture(scope="module")
def scan_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("scans") / "bump.db"
    write_scan(path)
    return path


class Filter:
    """A running filter node, what it publishes, and the hand that it listens to."""

    def __init__(self, process, probe, hand):
        from diagnostic_msgs.msg import DiagnosticArray

        from tactile_localizer.msg import Posterior

        self.process, self.probe, self.hand = process, probe, hand
        self.posteriors = probe.listen(Posterior, "filter/posterior", 1000)
        self.diagnostics = probe.listen(DiagnosticArray, "/diagnostics", 10)
        probe.until(lambda: probe.node.count_publishers("filter/posterior"), "the filter's posterior")
        probe.until(lambda: self.diagnostics, "diagnostics: a publisher that is matched")

    def fresh(self):
        return [message for message in self.posteriors if not message.stale]

    def wait_for_sample(self, k):
        """Wait for the posterior of strain vector ``k``."""
        self.probe.until(
            lambda: (
                self.posteriors and stamp_of(self.fresh()[-1]) >= self.hand.offset_ns + self.hand.strain_ns[k]
            ),
            f"the posterior of strain {k}",
        )

    def slide(self, samples, **how):
        """Slide on and wait for the last of the posteriors; no queue is ever full."""
        while samples > 0:
            self.hand.slide(min(samples, _QUEUE // 2), **how)
            self.wait_for_sample(self.hand.next - 1)
            samples -= _QUEUE // 2

    def means(self):
        return np.array([message.mean for message in self.fresh()])

    def told(self, what):
        """Level, message and values of the newest diagnostics called ``what``."""
        for array in reversed(self.diagnostics):
            for status in array.status:
                if status.name == f"filter: {what}":
                    return status.level, status.message, {v.key: v.value for v in status.values}
        return b"", "", {}


@pytest.fixture
def start(node_process, probe, scan_file):
    """Start the node on the scan of the bump."""

    def start(**parameters):
        node = node_process("filter_node", {"scan_file": scan_file, **CELL, **parameters})
        return Filter(node, probe, SlidingHand(probe, unseen_sweep()))

    return start


def offline(hand, samples, scan_file, configuration):
    """What the same localizer says of the same strains and positions without ROS."""
    with ScanStore.open(scan_file) as store:
        localizer = build_localizer(store.load(), store.scene, configuration, np.random.default_rng(0))
    localizer.reset()
    positions = hand.positions()
    return [
        localizer.update(hand.offset_ns + int(hand.strain_ns[k]), positions[k], hand.sweep.strain[k])
        for k in samples
    ]


@pytest.mark.parametrize("choices", [CELL, PAPER], ids=["grid", "the paper's particles"])
def test_live_it_believes_the_same_as_the_localizer_without_ros(start, scan_file, choices):
    node = start(**choices)
    node.slide(150)
    heard = node.fresh()
    samples = [node.hand.sample_of(message) for message in heard]
    assert samples == list(range(150))
    expected = offline(node.hand, samples, scan_file, Configuration(**choices))
    np.testing.assert_allclose(node.means(), [e.mean for e in expected], atol=1e-9)
    np.testing.assert_allclose(
        [m.covariance for m in heard], [e.covariance.ravel() for e in expected], atol=1e-12
    )
    np.testing.assert_allclose([m.covariance_trace for m in heard], [e.trace for e in expected])
    np.testing.assert_allclose([m.evidence for m in heard], [e.evidence for e in expected], atol=1e-6)
    assert [m.converged for m in heard] == [e.converged for e in expected]
    assert [m.reason for m in heard] == [e.reason for e in expected]
    assert [m.particles for m in heard] == [e.hypotheses for e in expected]
    assert {tuple(m.axes) for m in heard} == {("x", "y")}
    assert {m.header.frame_id for m in heard} == {"material"}
    assert node.process.stop() == 0
    assert "Traceback" not in node.process.output


def test_pose_flag_trace_and_particles_agree_with_the_posterior(start, probe):
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from sensor_msgs.msg import PointCloud2
    from std_msgs.msg import Bool, Float64
    from visualization_msgs.msg import MarkerArray

    poses = probe.listen(PoseWithCovarianceStamped, "filter/pose", 1000)
    flags = probe.listen(Bool, "filter/converged", 1000)
    traces = probe.listen(Float64, "filter/covariance_trace", 1000)
    clouds = probe.listen(PointCloud2, "filter/particles", 100)
    markers = probe.listen(MarkerArray, "filter/markers", 100)
    node = start(shown_particles=50, particles_rate_hz=5.0)
    for topic in ("pose", "converged", "covariance_trace", "particles", "markers"):
        probe.until(lambda topic=topic: probe.node.count_publishers(f"filter/{topic}"), topic)
    node.slide(100)
    posterior = node.fresh()[-1]
    probe.until(lambda: poses and stamp_of(poses[-1]) == stamp_of(posterior), "its pose")
    probe.until(lambda: len(flags) == len(poses) == len(traces), "flag and trace")
    pose = poses[-1]
    np.testing.assert_allclose([pose.pose.pose.position.x, pose.pose.pose.position.y], posterior.mean)
    covariance = np.reshape(pose.pose.covariance, (6, 6))
    np.testing.assert_allclose(covariance[:2, :2].ravel(), posterior.covariance)
    assert not covariance[2:].any()
    assert (flags[-1].data, traces[-1].data) == (posterior.converged, posterior.covariance_trace)
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


def test_the_map_is_kept_for_late_subscribers(start, probe):
    from rclpy.qos import DurabilityPolicy, QoSProfile
    from sensor_msgs.msg import PointCloud2
    from visualization_msgs.msg import Marker

    start()
    kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    clouds = probe.listen(PointCloud2, "filter/map", kept)
    regions = probe.listen(Marker, "filter/feature_region", kept)
    probe.until(lambda: clouds and regions, "the map and the region")
    assert [field.name for field in clouds[0].fields][:4] == ["x", "y", "z", "felt"]
    assert clouds[0].width > 15_000
    assert len(regions[0].points) == 5


def test_a_phalanx_that_is_missing_is_left_out_and_told_of(start, probe):
    node = start()
    node.slide(20)
    node.slide(20, status=[1, 0])
    probe.until(lambda: node.told("inputs")[2].get("absent_index") == "20", "the missing phalanx")
    assert node.told("inputs")[2]["absent_middle"] == "0"


def test_strain_that_is_not_finite_is_refused_and_counted(start, probe):
    node = start()
    node.slide(20)
    bad = np.array(node.hand.sweep.strain[20])
    bad[3] = np.nan
    node.hand.feel(20, strain=bad.tolist())
    node.hand.next += 1
    node.slide(5)
    assert 20 not in [node.hand.sample_of(message) for message in node.fresh()]
    probe.until(lambda: node.told("inputs")[2].get("refused") == "1", "the refusal")
    assert node.process.running


def test_inputs_that_never_come_are_told_of(start, probe):
    node = start()
    probe.until(lambda: node.told("inputs")[1] == "no strain and no palm_pose", "the missing inputs")
    assert node.told("inputs")[0] == b"\x01"
    assert node.posteriors == [], "no position is made up"
    node.slide(10)
    assert not node.posteriors[-1].stale


def test_strain_vectors_that_never_come_are_counted(start, probe):
    node = start()
    node.slide(10)
    node.hand.feel(10, sequence=[13, 13])  # the 10th to the 12th were lost on the way
    node.hand.next += 1
    node.slide(5, sequence=[14, 14])
    probe.until(lambda: node.told("inputs")[2].get("lost") == "3", "what was lost")
    told = [s.message for array in node.diagnostics for s in array.status if s.name == "filter: inputs"]
    assert any("3 strain vectors that never came" in message for message in told)


def test_late_poses_are_waited_for_and_make_the_same_belief(start, probe):
    node = start(stale_timeout_s=5.0)
    node.hand.slide(20, poses=False)
    for k in range(21):
        node.hand.pose(k)
    node.wait_for_sample(19)
    assert len(node.fresh()) == 20


def test_when_poses_stop_the_last_position_is_sent_as_stale_until_they_come_again(start, probe):
    from std_msgs.msg import Bool

    flags = probe.listen(Bool, "filter/converged", 1000)
    node = start()
    node.slide(100)
    last = node.fresh()[-1]
    node.hand.slide(40, poses=False)
    probe.until(lambda: node.posteriors[-1].stale, "stale")
    stale = node.posteriors[-1]
    assert (list(stale.mean), stamp_of(stale)) == (list(last.mean), stamp_of(last))
    assert not stale.converged
    assert stale.reason.startswith("stale: no palm")
    probe.until(lambda: flags and not flags[-1].data, "the flag")
    probe.until(lambda: node.told("inputs")[0] == b"\x02", "the diagnostics' error")
    assert "no palm" in node.told("inputs")[1]
    node.slide(10)
    assert not node.posteriors[-1].stale
    assert node.told("belief")[0] in (b"\x00", b"\x03")


def test_when_strain_stops_the_last_position_is_sent_as_stale(start, probe):
    node = start()
    node.slide(20)
    node.hand.slide(20, strain=False)
    probe.until(lambda: node.posteriors[-1].stale, "stale")
    assert "no strain" in node.posteriors[-1].reason
    held = len(node.posteriors)
    probe.until(lambda: len(node.posteriors) >= held + 2, "it is repeated for who comes late")
    assert {tuple(m.mean) for m in node.posteriors[held:]} == {tuple(node.fresh()[-1].mean)}


def test_a_bag_that_loops_begins_anew(start):
    node = start()
    node.slide(100)
    first = node.means()
    node.posteriors.clear()
    node.hand.next = 0
    node.slide(50)
    np.testing.assert_allclose(node.means()[:50], first[:50], atol=1e-9)


def test_stamps_of_zero_are_not_yet(start, probe):
    node = start()
    node.slide(5)
    seen = len(node.posteriors)
    node.hand.offset_ns = -int(node.hand.strain_ns[5])
    node.hand.feel(5)
    node.hand.offset_ns = START_NS
    node.slide(5)
    assert len(node.fresh()) == seen + 5


def test_the_belief_can_be_spread_again(start, probe):
    from std_srvs.srv import Empty

    node = start()
    node.slide(180)
    assert node.fresh()[-1].travel > 0.03
    probe.call(Empty, "filter/reinitialize_global_localization")
    node.slide(4)
    again = node.fresh()[-1]
    assert again.travel < 0.005
    assert again.covariance_trace > 1e-4


def initial_pose(x, y, variance, frame="material"):
    from geometry_msgs.msg import PoseWithCovarianceStamped

    message = PoseWithCovarianceStamped()
    message.header.frame_id = frame
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    message.pose.pose.orientation.w = 1.0
    message.pose.covariance[0] = message.pose.covariance[7] = variance
    return message


def test_the_belief_can_be_seeded_with_a_pose(start, probe):
    from geometry_msgs.msg import PoseWithCovarianceStamped

    node = start()
    node.slide(20)
    publisher = probe.publisher(PoseWithCovarianceStamped, "filter/initial_pose")
    publisher.publish(initial_pose(0.01, 0.04, 1e-6))
    node.process.wait_for_line("belief seeded")
    node.slide(1)
    np.testing.assert_allclose(node.means()[-1], [0.01, 0.04], atol=2e-3)
    assert node.fresh()[-1].covariance_trace < 1e-5


def test_seeds_that_cannot_be_used_are_refused_and_the_belief_goes_on(start, probe):
    from geometry_msgs.msg import PoseWithCovarianceStamped

    node = start()
    node.slide(50)
    publisher = probe.publisher(PoseWithCovarianceStamped, "filter/initial_pose", 10)
    publisher.publish(initial_pose(0.01, 0.04, 1e-6, "map"))
    node.process.wait_for_line("initial_pose: palm pose frame 'map': expected 'material' or 'base'")
    for pose in ((0.2, 0.04, 1e-6), (np.nan, 0.04, 1e-6), (0.01, 0.04, -1.0), (0.01, 0.04, np.nan)):
        publisher.publish(initial_pose(*pose))
    probe.until(lambda: node.told("inputs")[2].get("unread_initial_pose") == "5", "the refusals")
    travel = node.fresh()[-1].travel
    node.slide(5)
    assert node.fresh()[-1].travel > travel


def test_another_scan_is_loaded_only_from_the_named_directory(start, probe, scan_file, tmp_path):
    from tactile_localizer.srv import LoadScan

    directory = tmp_path / "scans"
    directory.mkdir()
    other = scene_of("snap")
    write_scan(directory / "snap.db", "snap", other)
    (directory / "foreign.db").write_text("not a scan " * 100)
    (directory / "link.db").symlink_to(scan_file)
    node = start(scan_directory=directory)
    node.slide(50)
    for path, reason in (
        (str(scan_file), "expected a path in"),
        ("../bump.db", "expected a path in"),
        ("link.db", "expected a path in"),
        ("none.db", "expected a scan file, found none"),
        ("foreign.db", "expected a scan file"),
    ):
        answer = probe.call(LoadScan, "filter/load_scan", LoadScan.Request(path=path))
        assert not answer.success
        assert reason in answer.message
    node.slide(5)
    assert node.fresh()[-1].travel > 0.01, "the belief went on"
    answer = probe.call(LoadScan, "filter/load_scan", LoadScan.Request(path="snap.db"), timeout_s=60.0)
    assert (answer.success, answer.message.split(": ")[0]) == (True, str(directory / "snap.db"))
    node.slide(5)
    assert node.fresh()[-1].travel < 0.005, "the belief began anew"
    probe.until(lambda: node.told("belief")[2].get("scan_file") == str(directory / "snap.db"), "the new map")


@pytest.fixture(scope="module")
def three_scans(tmp_path_factory):
    folder = tmp_path_factory.mktemp("features")
    for feature in ("bump", "snap", "grommet"):
        write_scan(folder / f"{feature}.db", feature)
    return [folder / f"{feature}.db" for feature in ("bump", "snap", "grommet")]


def test_of_several_scans_it_tells_which_feature_is_felt_as_the_identifier_without_ros(
    node_process, probe, three_scans
):
    from tactile_localizer.msg import FeatureProbabilities

    told = probe.listen(FeatureProbabilities, "filter/feature", 1000)
    process = node_process("filter_node", {"candidate_scan_files": three_scans, **CELL})
    node = Filter(process, probe, SlidingHand(probe, unseen_sweep("snap")))
    node.slide(150)
    probe.until(lambda: told and stamp_of(told[-1]) == stamp_of(node.fresh()[-1]), "its probabilities")
    candidates = {}
    for path in three_scans:
        with ScanStore.open(path) as store:
            candidates[store.scene.name] = store.load(), store.scene
    identifier = build_identifier(candidates, Configuration(**CELL), np.random.default_rng(0))
    hand = node.hand
    positions = hand.positions()
    for message, posterior in zip(told, node.fresh(), strict=True):
        k = hand.sample_of(message)
        stamp_ns = hand.offset_ns + int(hand.strain_ns[k])
        expected = identifier.update(stamp_ns, positions[k], hand.sweep.strain[k])
        assert list(message.names) == list(expected.probabilities)
        np.testing.assert_allclose(message.probabilities, list(expected.probabilities.values()), atol=1e-6)
        assert message.most_probable == expected.most_probable
        if expected.most_probable == "none of them":
            assert not posterior.converged
        else:
            believed = expected.estimates[expected.most_probable]
            np.testing.assert_allclose(posterior.mean, believed.mean, atol=1e-9)
    assert process.stop() == 0


def test_scans_of_one_name_cannot_be_told_apart(refusal, scan_file):
    (line,) = refusal("filter_node", {"candidate_scan_files": [scan_file, scan_file], **CELL})
    assert "candidate_scan_files: expected scenes of different names, got bump, bump" in line


def test_without_a_directory_no_scan_can_be_loaded(start, probe, scan_file):
    from tactile_localizer.srv import LoadScan

    start()
    answer = probe.call(LoadScan, "filter/load_scan", LoadScan.Request(path=str(scan_file)))
    assert not answer.success
    assert (
        answer.message == "scan_directory: expected a directory that scan files may be read from, found none"
    )


def test_the_diagnostics_tell_of_belief_and_work(start, probe):
    node = start()
    node.slide(100)
    probe.until(lambda: "update_p99_us" in node.told("belief")[2], "the diagnostics")
    probe.until(lambda: node.told("belief")[2]["travel_m"] == f"{node.fresh()[-1].travel:.4f}", "the newest")
    _, _, values = node.told("belief")
    posterior = node.fresh()[-1]
    assert values["reason"] == posterior.reason
    assert values["evidence_nat"] == f"{posterior.evidence:.2f}"
    assert 0 < float(values["update_median_us"]) <= float(values["update_p99_us"])
    assert float(values["update_p99_us"]) <= float(values["update_worst_us"])
    _, _, inputs = node.told("inputs")
    assert int(inputs["weighed"]) + int(inputs["moved"]) == len(node.fresh())


def set_parameter(probe, name, value):
    from rcl_interfaces.srv import SetParameters
    from rclpy.parameter import Parameter

    request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
    return probe.call(SetParameters, "filter/set_parameters", request).results[0]


def test_what_may_change_while_it_runs_does_so_and_the_belief_stays(start, probe):
    node = start()
    node.slide(40)
    before = node.fresh()[-1]
    assert before.reason.endswith(f"of {Configuration().convergence_evidence:.1f} nats")
    for name, value in (
        ("convergence_evidence", 42.0),
        ("convergence_std", 1.0),
        ("convergence_travel", 0.0),
        ("update_distance", 0.0001),
        ("stale_timeout_s", 2.0),
        ("particles_rate_hz", 1.0),
        ("shown_particles", 10),
    ):
        answer = set_parameter(probe, name, value)
        assert answer.successful, answer.reason
    node.slide(1)
    after = node.fresh()[-1]
    np.testing.assert_allclose(after.mean, before.mean, atol=2e-3)
    assert after.travel > before.travel
    node.slide(5)
    assert node.fresh()[-1].reason.endswith("of 42.0 nats")


def test_what_may_not_change_while_it_runs_is_refused_with_the_reason(start, probe):
    node = start()
    node.slide(5)
    before = "expected to be set before the node is configured, and it is configured"
    for name, value, reason in (
        ("particles", 10, f"particles: {before}"),
        ("model", "gaussian", f"model: {before}"),
        ("scan_file", "/other.db", f"scan_file: {before}"),
        ("convergence_std", -1.0, "convergence_std"),
        ("stale_timeout_s", 1e6, "stale_timeout_s"),
        ("stale_timeout_s", "long", "Wrong parameter type"),
    ):
        answer = set_parameter(probe, name, value)
        assert not answer.successful
        assert reason in answer.reason
    node.slide(5)
    assert not node.fresh()[-1].stale


def test_best_effort_can_be_overridden_from_outside(node_process, probe, scan_file):
    name = "qos_overrides./strain.subscription.reliability"
    node_process("filter_node", {"scan_file": scan_file, **CELL, name: "reliable"})

    def reliabilities():
        return [
            info.qos_profile.reliability.name.lower()
            for info in probe.node.get_subscriptions_info_by_topic("/strain")
        ]

    probe.until(reliabilities, "the subscription")
    assert reliabilities() == ["reliable"]


def test_each_choice_of_the_configuration_is_a_parameter_with_its_default():
    from tactile_localizer.nodes.filter_parameters import CONFIGURATION

    fields = {field.name: field.default for field in dataclasses.fields(Configuration)}
    assert {parameter.name: parameter.default for parameter in CONFIGURATION} == fields


def missing_scan(tmp_path):
    return {"scan_file": tmp_path / "none.db"}, "none.db: expected a scan file, found none"


def no_scan(tmp_path):
    return {"scan_file": "''"}, "scan_file: expected a path, got none"


def foreign_scan(tmp_path):
    (tmp_path / "scan.db").write_text("not a scan " * 100)
    return {"scan_file": tmp_path / "scan.db"}, "scan.db: expected a scan file, file is not a database"


def empty_scan(tmp_path):
    ScanStore.create(tmp_path / "scan.db", scene_of()).close()
    return {"scan_file": tmp_path / "scan.db"}, "expected at least one state-measurement pair, found none"


def missing_scene(tmp_path):
    return {"scene_file": tmp_path / "none.yaml"}, "none.yaml: expected a scene file"


def unknown_phalanx(tmp_path):
    scene = scene_of()
    scene = dataclasses.replace(scene, phalanges=(*scene.phalanges, Phalanx("ring", (0.0, -0.03))))
    save_scene(scene, tmp_path / "scene.yaml")
    return (
        {"scene_file": tmp_path / "scene.yaml"},
        "phalanx 'ring' of scene 'bump': expected one of index, middle",
    )


def unknown_axis(tmp_path):
    axes = (Axis("x", 0.0, 0.05), Axis("yaw", -1.0, 1.0))
    save_scene(Scene("turned", axes, (Phalanx("index", (0.0, 0.0)),), None, MEASUREMENT), tmp_path / "s.yaml")
    return {"scene_file": tmp_path / "s.yaml"}, "axis 'yaw' of scene 'turned': expected one of x, y"


def choices_that_do_not_go_together(tmp_path):
    return {"recovery": "constant"}, "recovery constant: expected filter particle, got grid"


def unknown_model(tmp_path):
    return {"model": "oracle"}, "model 'oracle': expected one of sum_of_gaussians"


def negative_particles(tmp_path):
    return {"particles": -1}, "particles"


def short_material_pose(tmp_path):
    return {"material_pose": [1.0, 2.0]}, "material_pose: expected x, y, z, roll, pitch, yaw"


BAD = [
    missing_scan,
    no_scan,
    foreign_scan,
    empty_scan,
    missing_scene,
    unknown_phalanx,
    unknown_axis,
    choices_that_do_not_go_together,
    unknown_model,
    negative_particles,
    short_material_pose,
]


@pytest.mark.parametrize("spoil", BAD, ids=lambda spoil: spoil.__name__)
def test_a_configuration_that_cannot_work_is_refused_with_one_line(refusal, scan_file, tmp_path, spoil):
    parameters, message = spoil(tmp_path)
    (line,) = refusal("filter_node", {"scan_file": scan_file, **CELL, **parameters})
    assert message in line


def test_the_process_ends_when_its_configuration_is_refused(node_process, tmp_path):
    process = node_process("filter_node", {"scan_file": tmp_path / "none.db"})
    assert process.wait() == 2
    assert "none.db: expected a scan file, found none" in process.output
    assert len(process.lines) == 1


def test_a_refused_configuration_can_be_tried_again_when_its_cause_is_mended(
    node_process, probe, scan_file, tmp_path
):
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState, GetState

    path = tmp_path / "later.db"
    process = node_process("filter_node", {"scan_file": path, "autostart": False, **CELL})

    def change(transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        return probe.call(ChangeState, "filter/change_state", request, timeout_s=60.0).success

    assert not change(Transition.TRANSITION_CONFIGURE)
    assert f"{path}: expected a scan file, found none" in process.output
    assert probe.call(GetState, "filter/get_state").current_state.label == "unconfigured"
    shutil.copy(scan_file, path)
    assert change(Transition.TRANSITION_CONFIGURE)
    assert change(Transition.TRANSITION_ACTIVATE)
    node = Filter(process, probe, SlidingHand(probe, unseen_sweep()))
    node.slide(5)
    assert process.stop() == 0
    assert "Traceback" not in process.output


def test_the_shipped_parameter_file_holds_the_recommended_choices():
    import yaml

    from tactile_localizer.nodes.filter_parameters import PARAMETERS
    from tactile_localizer.resources import resource_path

    shipped = yaml.safe_load(resource_path("config/filter.yaml").read_text())["/**"]["ros__parameters"]
    defaults = {parameter.name: parameter.default for parameter in PARAMETERS}
    assert shipped == {name: defaults[name] for name in shipped}
