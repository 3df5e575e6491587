"""Palm poses of a bag come from several types of messages, or from tf."""

import numpy as np
import pytest
from support.bags import MS, SCENE, START, STORE, pose, slide, strain, write_bag, x_at
from support.notes import counts

from tactile_localizer.errors import ScanError
from tactile_localizer.io.bags.recording import read_bag
from tactile_localizer.streams.palm_frame import PalmFrame

T = STORE.types
STRAIN_MS = np.arange(20, 1001, 5)


def felt(first_ms=0, last_ms=1000):
    return [("strain", ms, strain(ms)) for ms in range(first_ms + 5, last_ms + 1, 5)]


def transform(ms, parent, child, x=None, y=0.0):
    place = T["geometry_msgs/msg/Vector3"](x=float(x_at(ms) if x is None else x), y=y, z=0.0)
    turn = T["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    inner = T["geometry_msgs/msg/Transform"](translation=place, rotation=turn)
    header = pose(ms, parent).header
    return T["geometry_msgs/msg/TransformStamped"](header=header, child_frame_id=child, transform=inner)


def with_covariance(ms):
    return T["geometry_msgs/msg/PoseWithCovariance"](pose=pose(ms).pose, covariance=np.zeros(36))


def odometry(ms):
    zero = T["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
    twist = T["geometry_msgs/msg/Twist"](linear=zero, angular=zero)
    twist = T["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=np.zeros(36))
    kind = T["nav_msgs/msg/Odometry"]
    return kind(header=pose(ms).header, child_frame_id="palm", pose=with_covariance(ms), twist=twist)


def stamped_with_covariance(ms):
    kind = T["geometry_msgs/msg/PoseWithCovarianceStamped"]
    return kind(header=pose(ms).header, pose=with_covariance(ms))


def test_late_strain_has_the_positions_where_it_was_felt(tmp_path):
    """Between poses, however seldom there is strain."""
    felt_ms = np.arange(30, 900, 190)
    strains = [("strain", ms, strain(ms)) for ms in (felt_ms + 70).tolist()]
    poses = [("palm_pose", ms, pose(ms)) for ms in range(20, 1001, 20)]
    true = [("tactile_simulator/ground_truth", ms, pose(ms, x=x_at(ms) + 0.01)) for _, ms, _ in poses]
    (sweep,) = read_bag(write_bag(tmp_path / "bag", strains + poses + true), SCENE, delay_s=0.07).sweeps
    np.testing.assert_array_equal(sweep.stamp_ns, START + felt_ms * MS)
    np.testing.assert_allclose(sweep.position[:, 0], x_at(felt_ms))
    np.testing.assert_allclose(sweep.truth[:, 0], x_at(felt_ms) + 0.01)


@pytest.mark.parametrize(
    "message",
    [
        pose,
        stamped_with_covariance,
        odometry,
        lambda ms: transform(ms, "material", "palm", y=0.02),
    ],
)
def test_poses_are_of_several_types(tmp_path, message):
    poses = [("arm", ms, message(ms)) for ms in range(20, 1001, 20)]
    recording = read_bag(write_bag(tmp_path / "bag", felt() + poses), SCENE, topics={"pose": "/arm"})
    (sweep,) = recording.sweeps
    np.testing.assert_array_equal(sweep.stamp_ns, START + STRAIN_MS * MS)
    np.testing.assert_allclose(sweep.position, np.stack([x_at(STRAIN_MS), np.full(197, 0.02)], axis=1))


def tf(topic, ms, *transforms):
    return (topic, ms, T["tf2_msgs/msg/TFMessage"](transforms=list(transforms)))


def arm(first_ms=0, last_ms=1000, step=20):
    """A moving arm with a tool that is fixed to it, and another frame."""
    fixed = [tf("tf_static", 0, transform(0, "flange", "tool0", x=0.001, y=0.02))]
    moving = [
        tf("tf", ms, transform(ms, "world", "lamp", x=9.0), transform(ms, "base_link", "flange"))
        for ms in range(first_ms + step, last_ms + 1, step)
    ]
    return fixed + moving


def test_poses_are_looked_up_in_tf(tmp_path):
    bag = write_bag(tmp_path / "bag", felt() + arm())
    recording = read_bag(bag, SCENE, palm_frame="tool0")
    (sweep,) = recording.sweeps
    np.testing.assert_array_equal(sweep.stamp_ns, START + STRAIN_MS * MS)
    np.testing.assert_allclose(sweep.position[:, 0], x_at(STRAIN_MS) + 0.001)
    assert sweep.gaps == 3
    frame = PalmFrame(SCENE.axes, reference_frame="base_link", material_pose=[0.001, 0.01, 0, 0, 0, 0])
    (moved,) = read_bag(bag, SCENE, palm_frame="/tool0", frame=frame).sweeps
    np.testing.assert_allclose(moved.position, np.stack([x_at(STRAIN_MS), np.full(197, 0.01)], axis=1))


def test_transforms_too_far_apart_leave_a_gap(tmp_path):
    bag = write_bag(tmp_path / "bag", felt() + arm(step=200))
    recording = read_bag(bag, SCENE, palm_frame="tool0")
    assert [(len(sweep), sweep.gaps) for sweep in recording.sweeps] == [(5, 195)]
    assert "/tf: the poses are 0.2 s apart" in recording.notes[0]
    assert len(read_bag(bag, SCENE, palm_frame="tool0", max_gap_s=0.2)) == 161


def test_two_publishers_of_a_transform_are_a_finding(tmp_path):
    other = [tf("tf", ms + 10, transform(ms + 10, "base_link", "flange", x=0.03)) for ms in range(0, 990, 20)]
    (note,) = read_bag(write_bag(tmp_path / "bag", felt() + arm() + other), SCENE, palm_frame="tool0").notes
    assert note.startswith("/tf: the position jumps by ")


def test_transforms_before_a_jump_do_not_count_after_it(tmp_path):
    """As in the nodes, which forget them."""
    happened = felt(4000, 5000) + arm(4000, 5000)
    later = [(topic, 5000 + ms, message) for topic, ms, message in felt() + arm() if topic != "tf_static"]
    sweeps = read_bag(write_bag(tmp_path / "bag", happened + later), SCENE, palm_frame="tool0").sweeps
    assert [(len(sweep), sweep.stamp_ns[0] // MS - START // MS) for sweep in sweeps] == [
        (197, 4020),
        (197, 20),
    ]


def test_the_option_for_tf_and_its_frames_are_named(tmp_path):
    bag = write_bag(tmp_path / "bag", felt() + arm())
    with pytest.raises(ScanError, match=r"expected messages of /palm_pose, found .*--palm-frame FRAME"):
        read_bag(bag, SCENE)
    with pytest.raises(
        ScanError, match=r"from wrist to base_link, found .* base_link, flange, lamp, tool0, w"
    ):
        read_bag(bag, SCENE, palm_frame="wrist")
    with pytest.raises(ScanError, match=r"expected messages of /tf, found /strain"):
        read_bag(write_bag(tmp_path / "none", felt()), SCENE, palm_frame="tool0")


def test_stamps_of_zero_are_named(tmp_path):
    happened = [(topic, ms, strain(0) if topic == "strain" else one) for topic, ms, one in slide(0, 500)]
    refusal = r"skipped 100 of 100 messages of /strain: expected a stamp, found 0: the clock of the sender"
    with pytest.raises(ScanError, match=refusal):
        read_bag(write_bag(tmp_path / "bag", happened), SCENE)
    happened = [*slide(0, 500), ("palm_pose", 100, pose(0, x=0.04))]
    assert counts(read_bag(write_bag(tmp_path / "some", happened), SCENE).notes) == [(1, 26)]


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("x", [1e200, 1.7e308, np.inf])
def test_poses_of_impossible_size_are_skipped(tmp_path, x):
    wild = [("palm_pose", ms, pose(ms, x=x * (-1) ** (ms // 200))) for ms in range(110, 1000, 200)]
    recording = read_bag(write_bag(tmp_path / "bag", slide(0, 1000) + wild), SCENE)
    assert counts(recording.notes) == [(5, 55)]
    assert "of /palm_pose: palm pose: expected finite x, y, got [" in recording.notes[0]
    assert len(recording) == len(STRAIN_MS)


def poses_of(rate, x=x_at, late_ms=0):
    """Poses every ``1 / rate`` s, whose stamps are behind their receipt."""
    return [("palm_pose", ms + late_ms, pose(ms, x=x(ms))) for ms in range(0, 2000, round(1000 / rate)) if ms]


WHAT = ("strain vectors", "poses of /palm_pose")


def notes_of(path, poses):
    happened = [each for each in slide(0, 2000) if each[0] == "strain"]
    return read_bag(write_bag(path, happened + poses), SCENE).notes


def test_two_publishers_of_the_palm_pose_are_a_finding(tmp_path):
    other = [("palm_pose", ms + 3, pose(ms + 3, x=x_at(ms) + 0.02)) for ms in range(10, 2000, 10)]
    (note,) = notes_of(tmp_path / "bag", poses_of(100) + other)
    assert note.startswith("/palm_pose: the position jumps by 20 mm within 3 ms and back: two sources")


@pytest.mark.parametrize("late_ms", [-300, 300])
def test_stamps_far_from_their_receipt_are_a_finding(tmp_path, late_ms):
    (note,) = notes_of(tmp_path / "bag", poses_of(100, late_ms=late_ms))
    way = "behind" if late_ms > 0 else "ahead of"
    assert note.startswith(f"/palm_pose: stamps are 0.30 s {way} the strain received with them")
    assert notes_of(tmp_path / "slow", poses_of(100, late_ms=50)) == ()


@pytest.mark.parametrize("step_ms", [3_600_000, -2000], ids=["forward", "back"])
def test_a_clock_that_is_set_during_the_recording_is_not_another_clock(tmp_path, step_ms):
    def stamped(ms):
        return ms + 10_000 + step_ms * (ms >= 1000)

    times_ms = range(0, 2000, 10)
    poses = [("palm_pose", ms, pose(stamped(ms), x=x_at(ms))) for ms in times_ms]
    both = [("strain", ms, strain(stamped(ms))) for ms in times_ms] + poses
    notes = read_bag(write_bag(tmp_path / "both", both), SCENE).notes
    jumps = [f"1 of 200 {what} have stamps that jump back: another run begins" for what in WHAT]
    assert notes == (tuple(jumps) if step_ms < 0 else ())
    arm = [("strain", ms, strain(10_000 + ms)) for ms in times_ms] + poses
    notes = read_bag(write_bag(tmp_path / "arm", arm), SCENE).notes
    assert (jumps[1] in notes) == (step_ms < 0)
