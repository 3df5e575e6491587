"""Strain vectors are paired with the palm position at their stamps, whichever topic is late."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_localizer.core.geometry.pose_buffer import interpolate_poses
from tactile_localizer.core.geometry.synchronization import Pairing
from tactile_localizer.errors import MeasurementError
from tactile_localizer.scene import Axis

AXES = (Axis("x", 0.0, 1.0),)
MS = 1_000_000


def summary(pairs):
    return [(p.stamp_ns // MS, None if p.position is None else round(float(p.position[0]), 6)) for p in pairs]


def pose(pairing, stamp_ms, x):
    return summary(pairing.add_pose(stamp_ms * MS, np.array([x])))


def strain(pairing, stamp_ms):
    return summary(pairing.add_strain(stamp_ms * MS, None))


def test_a_strain_vector_waits_for_the_pose_that_follows_it():
    pairing = Pairing(AXES)
    assert pose(pairing, 100, 0.1) == []
    assert strain(pairing, 105) == []
    assert strain(pairing, 115) == []
    assert pairing.waiting_ns == 105 * MS
    assert pairing.newest_input_ns == pairing.newest_ns == 115 * MS
    assert pose(pairing, 110, 0.2) == [(105, 0.15)]
    assert pose(pairing, 120, 0.3) == [(115, 0.25)]
    assert pairing.waiting_ns is None
    assert pairing.newest_input_ns == pairing.newest_pose_ns == 120 * MS


def test_a_strain_vector_after_its_poses_is_paired_at_once():
    pairing = Pairing(AXES)
    pose(pairing, 100, 0.1)
    pose(pairing, 110, 0.2)
    assert strain(pairing, 104) == [(104, 0.14)]


def test_a_gap_in_the_poses_gives_no_position():
    pairing = Pairing(AXES, max_gap_s=0.05)
    pose(pairing, 100, 0.1)
    strain(pairing, 120)
    assert pose(pairing, 200, 0.2) == [(120, None)]


def test_patience_is_measured_by_stamps():
    pairing = Pairing(AXES, patience_s=0.1)
    pose(pairing, 100, 0.1)
    assert strain(pairing, 150) == []
    assert strain(pairing, 250) == []
    assert strain(pairing, 251) == [(150, None)]
    assert summary(pairing.finish()) == [(250, None), (251, None)]


def test_late_messages_are_dropped_and_counted():
    pairing = Pairing(AXES)
    pose(pairing, 100, 0.1)
    pose(pairing, 110, 0.2)
    assert pose(pairing, 105, 0.9) == []
    assert strain(pairing, 106) == [(106, 0.16)]
    assert strain(pairing, 104) == []
    assert pairing.late == 2


@pytest.mark.parametrize("first", ["pose", "strain"])
def test_a_backward_jump_of_either_topic_resets(first):
    pairing = Pairing(AXES)
    pose(pairing, 100_000, 0.1)
    strain(pairing, 100_001)
    if first == "pose":
        assert pose(pairing, 100, 0.5) == [(100_001, None)]
        assert strain(pairing, 105) == []
    else:
        assert strain(pairing, 105) == [(100_001, None)]
        assert pose(pairing, 100, 0.5) == []
    assert pose(pairing, 110, 0.7) == [(105, 0.6)]
    assert pairing.resets == 1


def test_a_refused_pose_changes_nothing():
    pairing = Pairing(AXES)
    pose(pairing, 100, 0.1)
    with pytest.raises(MeasurementError):
        pose(pairing, 105, np.nan)
    strain(pairing, 105)
    assert pose(pairing, 110, 0.2) == [(105, 0.15)]


@given(
    order=st.permutations(["pose"] * 12 + ["strain"] * 15),
    pose_steps=st.lists(st.integers(1, 150), min_size=12, max_size=12),
    strain_steps=st.lists(st.integers(1, 100), min_size=15, max_size=15),
)
def test_pairs_do_not_depend_on_the_order_of_arrival(order, pose_steps, strain_steps):
    pose_ms, strain_ms = np.cumsum(pose_steps), np.cumsum(strain_steps)
    x = np.random.default_rng(0).uniform(0, 1, len(pose_ms))
    pairing = Pairing(AXES, patience_s=10.0)
    waiting = {"pose": list(zip(pose_ms, x, strict=True)), "strain": list(strain_ms)}
    pairs = []
    for kind in order:
        if kind == "pose":
            stamp, value = waiting["pose"].pop(0)
            pairs += pairing.add_pose(int(stamp) * MS, np.array([value]))
        else:
            pairs += pairing.add_strain(int(waiting["strain"].pop(0)) * MS, None)
    pairs += pairing.finish()
    expected, found = interpolate_poses(AXES, pose_ms * MS, x[:, None], strain_ms * MS)
    assert [pair.stamp_ns for pair in pairs] == list(strain_ms * MS)
    assert [pair.position is not None for pair in pairs] == list(found)
    for pair, position in zip(pairs, expected, strict=True):
        if pair.position is not None:
            np.testing.assert_array_equal(pair.position, position)
