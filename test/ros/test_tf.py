"""Palm poses from tf with the real buffer, and the pose of the material published to tf."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.filter import CELL, Filter
from support.sweeps import SlidingHand, set_stamp, stamp_of, unseen_sweep

pytestmark = pytest.mark.ros

MS = 1_000_000
START = 1_700_000_000_000 * MS


def pose_matrix(translation: Any, rotation: Rotation) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation.as_matrix(), translation
    return matrix


def test_the_transform_agrees_with_palm_and_posterior() -> None:
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
def test_tf_parameters_require_tf(refusal: Any, tmp_path: Any, parameters: Any) -> None:
    try:
        import tf2_ros
    except ImportError:
        (line,) = refusal("filter_node", {"scan_file": tmp_path / "none_scan", **parameters})
        assert "to be installed, found none" in line
    else:
        pytest.skip(f"{tf2_ros.__name__} is installed")


class Poses:
    """A lookup with the real buffer, its poses and its failures."""

    def __init__(self, patience_s: float = 0.5) -> None:
        pytest.importorskip("tf2_ros", reason="tf2_ros is not installed: only a ROS 2 distribution has it")
        from tactile_localizer.ros.subscriptions.tf_poses import PalmLookup

        self.found: list[Any] = []
        self.missed: list[str] = []
        self.lookup = PalmLookup(
            "base_link", "palm", patience_s, self.found.append, lambda error: self.missed.append(str(error))
        )
        self.callbacks: list[Any] = []
        self.lookup.subscribe(
            SimpleNamespace(create_subscription=lambda *given: self.callbacks.append(given[2]))  # type: ignore[arg-type]
        )

    def send(self, ms: int, x: float, parent: str = "base_link", child: str = "palm", topic: int = 0) -> None:
        from geometry_msgs.msg import TransformStamped

        transform = TransformStamped(child_frame_id=child)
        transform.header.frame_id = parent
        set_stamp(transform, START + ms * MS)
        transform.transform.translation.x = x
        transform.transform.rotation.w = 1.0
        self.callbacks[topic](SimpleNamespace(transforms=[transform]))

    def look_up(self, *stamps_ms: int) -> None:
        for ms in stamps_ms:
            self.lookup.look_up(START + ms * MS)

    def places(self) -> list[tuple[int, float]]:
        """Stamps, ms, and x of the poses found."""
        return [((stamp_of(m) - START) // MS, round(m.pose.position.x, 9)) for m in self.found]


def test_a_pose_is_looked_up_between_transforms() -> None:
    poses = Poses()
    poses.send(0, 0.0)
    poses.send(20, 0.02)
    poses.look_up(5, 10)
    assert poses.places() == [(5, 0.005), (10, 0.01)]
    assert poses.found[0].header.frame_id == "base_link"


def test_a_late_transform_is_waited_for() -> None:
    poses = Poses()
    poses.send(0, 0.0)
    poses.look_up(5, 25)
    assert poses.places() == []
    poses.send(20, 0.02)
    assert poses.places() == [(5, 0.005)]
    poses.send(40, 0.04)
    assert poses.places() == [(5, 0.005), (25, 0.025)]
    assert poses.missed == []


def test_a_missing_transform_fails_after_the_patience() -> None:
    poses = Poses(patience_s=0.1)
    poses.look_up(0, 50, 100)
    assert poses.missed == []
    poses.look_up(150)
    assert len(poses.missed) == 1
    assert '"base_link" passed to lookupTransform' in poses.missed[0]


def test_lookups_before_the_first_transform_fail() -> None:
    poses = Poses(patience_s=0.1)
    poses.send(100, 0.1)
    poses.send(300, 0.3)
    poses.look_up(50)
    assert len(poses.missed) == 1, "it is not waited for"
    poses.look_up(200)
    assert poses.places() == [(200, 0.2)]
    assert "extrapolation into the past" in poses.missed[0]


def test_static_frames_are_chained() -> None:
    poses = Poses()
    poses.send(0, 1.0, "wrist", "palm", topic=1)
    poses.send(0, 0.0, "base_link", "wrist")
    poses.send(20, 0.02, "base_link", "wrist")
    poses.look_up(10)
    assert poses.places() == [(10, 1.01)]


def test_a_looping_bag_clears_the_buffer() -> None:
    poses = Poses()
    for loop in range(2):
        for ms in range(0, 20_000, 20):
            poses.send(ms, loop + ms / 1000)
            poses.look_up(ms)
        assert poses.places()[-1] == (19_980, loop + 19.98)
    begun_anew = poses.places()[1000:]
    assert len(begun_anew) >= 998, "at most the first of the second time is lost"
    assert [x for _, x in begun_anew] == pytest.approx([1 + ms / 1000 for ms, _ in begun_anew])


def test_a_filter_on_tf_publishes_the_material(node_process: Any, probe: Any, scan_file: Any) -> None:
    pytest.importorskip("tf2_msgs", reason="tf2_msgs is not installed: only a ROS 2 distribution has it")
    from geometry_msgs.msg import TransformStamped
    from tf2_msgs.msg import TFMessage

    class HandOnTf(SlidingHand):
        def send_pose(self, k: int) -> None:
            transform = TransformStamped(child_frame_id="left_palm")
            transform.header.frame_id = "base_link"
            set_stamp(transform, self.offset_ns + int(self.pose_ns[k]))
            place = transform.transform.translation
            place.x, place.y = map(float, self.sweep.position[k])
            transform.transform.rotation.w = 1.0
            self.tf.publish(TFMessage(transforms=[transform]))

    parameters = {"pose_source": "tf", "palm_frame": "left_palm", "material_frame": "left_material"}
    process = node_process("filter_node", {"scan_file": scan_file, "publish_tf": True, **parameters, **CELL})
    HandOnTf.tf = probe.publisher(TFMessage, "/tf", 100, timeout_s=60.0)
    hand = HandOnTf(probe, unseen_sweep(), topics=("strain", "no_pose"), poses=False)
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
