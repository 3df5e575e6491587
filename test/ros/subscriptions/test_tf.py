"""Palm poses from tf with the real buffer, and the pose of the material published to tf."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.filter import CELL, Filter
from support.hand import SlidingHand, set_stamp, stamp_of
from support.sweeps import unseen_sweep

pytestmark = pytest.mark.ros

MS = 1_000_000
START = 1_700_000_000_000 * MS


def pose_matrix(translation: Any, rotation: Rotation) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation.as_matrix(), translation
    return matrix


def test_the_transform_agrees_with_palm_and_posterior():
    from tactile_localizer.ros.publishers.material_transform import material_in_reference

    nominal = (0.5, -0.2, 0.9, 0.1, -0.2, 0.7)
    palm, mean = np.array([0.03, 0.01, 0.4]), np.array([0.05, -0.02, 0.1])
    translation, quaternion = material_in_reference(("x", "y", "yaw"), palm, mean, nominal)
    found = pose_matrix(translation, Rotation.from_quat(quaternion))
    on_material, in_nominal = (
        pose_matrix([place[0], place[1], 0.0], Rotation.from_euler("z", place[2])) for place in (mean, palm)
    )
    reference_nominal = pose_matrix(nominal[:3], Rotation.from_euler("xyz", nominal[3:]))
    np.testing.assert_allclose(found @ on_material, reference_nominal @ in_nominal, atol=1e-12)


@pytest.mark.parametrize("parameters", [{"pose_source": "tf"}, {"publish_tf": True}])
def test_tf_parameters_require_tf(refusal, tmp_path, parameters):
    try:
        import tf2_ros
    except ImportError:
        (line,) = refusal("filter_node", {"scan_file": tmp_path / "none_scan", **parameters})
        assert "to be installed, found none" in line
    else:
        pytest.skip(f"{tf2_ros.__name__} is installed")


class Poses:
    """The poses that the real buffer gives for transforms."""

    def __init__(self) -> None:
        pytest.importorskip("tf2_ros", reason="tf2_ros is not installed: only a ROS 2 distribution has it")
        from tactile_localizer.ros.subscriptions.tf_poses import TfPoses

        self.found: list[Any] = []
        self.poses = TfPoses("base_link", "palm", self.found.append)
        self.callbacks: list[Any] = []
        self.poses.subscribe(
            SimpleNamespace(create_subscription=lambda *given: self.callbacks.append(given[2]))  # type: ignore[arg-type]
        )

    def send(self, ms: int, x: float, parent: str = "base_link", child: str = "palm", topic: int = 0) -> None:
        from geometry_msgs.msg import TransformStamped

        transform = TransformStamped(child_frame_id=child)
        transform.header.frame_id = parent
        set_stamp(transform, START + ms * MS)
        transform.transform.translation.x = x
        transform.transform.rotation.w = 1.0
        self.callbacks[topic](SimpleNamespace(transforms=[transform]), {})

    def places(self) -> list[tuple[int, float]]:
        """Stamps, ms, and x of the poses found."""
        return [((stamp_of(m) - START) // MS, round(m.pose.position.x, 9)) for m in self.found]


def test_each_transform_gives_a_pose():
    poses = Poses()
    poses.send(0, 0.0)
    poses.send(20, 0.02)
    poses.send(20, 0.02)
    poses.send(10, 0.01)
    assert poses.places() == [(0, 0.0), (20, 0.02)]
    assert poses.found[0].header.frame_id == "base_link"


@pytest.mark.parametrize(
    ("transforms", "reason"),
    [
        ([("base_link", "tool0")], "no palm among base_link, tool0"),
        ([("base_link", "Palm")], "no palm (did you mean Palm?) among Palm, base_link"),
        ([("world", "palm")], "no base_link among palm, world"),
        ([("world", "palm"), ("map", "base_link")], "Could not find a connection between 'base_link' and"),
        (
            [("a", "b"), ("b", "a"), ("a", "palm"), ("c", "base_link")],
            "The tf tree is invalid because",
        ),
        ([("base_link", "palm"), ("base_link", "wrist")], "no newer one"),
        ([("base_link", "palm", 1)], "static, or without a stamp"),
        ([("base_link", "palm"), ("base_link", "palm", 0, math.nan)], "not finite, or without a frame: t"),
        ([("base_link", "wrist"), ("", "palm")], "not finite, or without a frame: transform to palm"),
        ([("base_link", "palm\x1b")], r"no palm (did you mean palm\x1b?) among base_link, palm\x1b"),
    ],
)
def test_frames_without_a_pose_are_described_until_there_is_one(capfd, transforms, reason):
    poses = Poses()
    assert not poses.poses.problem
    for parent, child, topic, x in (each + (0, 0.0)[len(each) - 2 :] for each in transforms):
        poses.send(0, x, parent, child, topic)
    found = poses.poses.problem
    assert found.startswith(f"from reference_frame base_link to palm_frame palm: {reason}")
    assert found.isprintable()
    assert not capfd.readouterr().err, "tf2 has nothing to add"
    poses.send(20, 0.02)
    assert poses.places()[-1] == (20, 0.02)


def test_static_frames_are_chained():
    poses = Poses()
    poses.send(0, 1.0, "wrist", "palm", topic=1)
    poses.send(0, 0.0, "base_link", "wrist")
    poses.send(20, 0.02, "base_link", "wrist")
    assert poses.places() == [(0, 1.0), (20, 1.02)]


def test_the_slowest_frame_between_sets_the_times_of_the_poses():
    poses = Poses()
    for ms in range(0, 2000, 10):
        poses.send(ms, ms / 1000, "base_link", "elbow")
        if ms % 500 == 0:
            poses.send(ms, 0.0, "elbow", "palm")
    assert poses.places() == [(0, 0.0), (500, 0.5), (1000, 1.0), (1500, 1.5)]


def test_a_looping_bag_clears_the_buffer():
    poses = Poses()
    once = [(ms, ms / 1000) for ms in range(0, 20_000, 20)]
    for loop in range(2):
        for ms, x in once:
            poses.send(ms, loop + x)
    assert poses.places() == [(ms, round(loop + x, 9)) for loop in range(2) for ms, x in once]


class HandOnTf(SlidingHand):
    """A hand whose poses are transforms from ``base_link`` to ``palm_frame``."""

    def __init__(self, probe: Any, palm_frame: str) -> None:
        messages = pytest.importorskip("tf2_msgs.msg", reason="only a ROS 2 distribution has tf2_msgs")
        self._message, self._palm_frame = messages.TFMessage, palm_frame
        self._tf = probe.publisher(self._message, "/tf", 100)
        super().__init__(probe, unseen_sweep(), poses=False)

    def send_pose(self, k: int) -> None:
        from geometry_msgs.msg import TransformStamped

        transform = TransformStamped(child_frame_id=self._palm_frame)
        transform.header.frame_id = "base_link"
        set_stamp(transform, self.offset_ns + int(self.pose_ns[k]))
        place = transform.transform.translation
        place.x, place.y = map(float, self.sweep.position[k])
        transform.transform.rotation.w = 1.0
        self._tf.publish(self._message(transforms=[transform]))


def test_poses_that_are_too_far_apart_are_not_interpolated(node_process, probe, scan_file):
    """Between them the hand may have stopped and gone on."""
    pytest.importorskip("tf2_msgs", reason="only a ROS 2 distribution has tf2_msgs")
    process = node_process("filter_node", {"pose_source": "tf", "scan_file": scan_file, **CELL})
    hand = HandOnTf(probe, "palm")
    node = Filter(process, probe, hand)
    node.slide(20)
    hand.slide(30, poses=False)
    node.slide(20)
    estimated = {hand.sample_of(one) for one in node.fresh()}
    assert {*range(20), *range(51, 70)} <= estimated
    assert not estimated & {*range(21, 50)}


def test_a_filter_on_tf_publishes_the_material(node_process, probe, scan_file):
    pytest.importorskip("tf2_msgs", reason="tf2_msgs is not installed: only a ROS 2 distribution has it")
    from tf2_msgs.msg import TFMessage

    parameters = {"pose_source": "tf", "palm_frame": "left_palm", "material_frame": "left_material"}
    process = node_process("filter_node", {"scan_file": scan_file, "publish_tf": True, **parameters, **CELL})
    hand = HandOnTf(probe, "left_palm")
    node = Filter(process, probe, hand)
    transforms: list[Any] = []

    def keep(message: Any) -> None:
        transforms.extend(one for one in message.transforms if one.child_frame_id == "left_material")

    probe.node.create_subscription(TFMessage, "/tf", keep, 1000)
    probe.known_to("tactile_filter")
    node.slide(180)
    converged = {stamp_of(posterior): posterior for posterior in node.fresh() if posterior.converged}
    assert transforms
    for transform in transforms:
        posterior = converged[stamp_of(transform)]
        k = hand.sample_of(transform)
        palm = [np.interp(hand.strain_ns[k], hand.pose_ns, places) for places in hand.sweep.position.T]
        expected = np.subtract(palm, posterior.mean)
        place = transform.transform.translation
        np.testing.assert_allclose([place.x, place.y], expected, atol=1e-9)
        assert transform.header.frame_id == "base_link"
