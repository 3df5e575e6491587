"""Bytes of messages are decoded as rosbags decodes them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.bags import pose, strain, write_bag

from tactile_localizer.io.bag_decode import pose_from_bytes, pose_of, strain_from_bytes, strain_of
from tactile_localizer.io.bag_reader import QuickKeep, read_messages, typestore

STORE = typestore()
STRAIN, POSE = "tactile_localizer/msg/StrainVectors", "geometry_msgs/msg/PoseStamped"
stamps = st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 10**9 - 1))
names = st.lists(
    st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=9), max_size=4
)


def header(stamp: tuple[int, int], frame: str) -> object:
    time = STORE.types["builtin_interfaces/msg/Time"](sec=stamp[0], nanosec=stamp[1])
    return STORE.types["std_msgs/msg/Header"](stamp=time, frame_id=frame)


@given(stamps, st.text("abc/é", max_size=9), names, st.integers(0, 33))
def test_strain_is_what_rosbags_makes_of_it(
    stamp: tuple[int, int], frame: str, phalanges: list[str], count: int
) -> None:
    message = STORE.types[STRAIN](
        header=header(stamp, frame),
        phalanges=phalanges,
        strain=np.arange(count) / 7.0,
        status=np.arange(len(phalanges), dtype=np.uint8),
        sequence=np.zeros(len(phalanges), np.uint32),
    )
    raw = bytes(STORE.serialize_cdr(message, STRAIN))
    found, expected = strain_from_bytes(raw), strain_of(STORE.deserialize_cdr(raw, STRAIN))
    assert found[:2] == expected[:2]
    np.testing.assert_array_equal(found.values, expected.values)
    np.testing.assert_array_equal(found.status, expected.status)


@given(stamps, st.text("abc/é", max_size=9), st.lists(st.floats(width=64), min_size=7, max_size=7))
def test_a_pose_is_what_rosbags_makes_of_it(stamp: tuple[int, int], frame: str, numbers: list[float]) -> None:
    place = STORE.types["geometry_msgs/msg/Point"](*numbers[:3])
    turn = STORE.types["geometry_msgs/msg/Quaternion"](*numbers[3:])
    message = STORE.types[POSE](header(stamp, frame), STORE.types["geometry_msgs/msg/Pose"](place, turn))
    raw = bytes(STORE.serialize_cdr(message, POSE))
    found, expected = pose_from_bytes(raw), pose_of(STORE.deserialize_cdr(raw, POSE))
    assert found[:2] == expected[:2]
    np.testing.assert_array_equal(found.translation + found.quaternion, numbers)
    np.testing.assert_array_equal(expected.translation + expected.quaternion, numbers)


def test_bytes_that_end_early_or_are_big_endian_are_refused() -> None:
    raw = bytes(STORE.serialize_cdr(pose(0), POSE))
    for cut in (2, 9, 20, 40):
        with pytest.raises((ValueError, struct.error)):
            pose_from_bytes(raw[:cut])
    with pytest.raises(ValueError, match="expected little-endian"):
        pose_from_bytes(b"\x00\x00" + raw[2:])


def test_another_type_under_a_topics_name_is_not_taken_for_the_expected_one(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", [("strain", 10, strain(10)), ("palm_pose", 10, pose(10))])
    keep = QuickKeep(STRAIN, lambda message: type(message).__name__, lambda raw: "bytes")
    found = read_messages(bag, {"/strain": keep, "/palm_pose": keep}).by_topic
    assert found["/strain"] == ["bytes"]
    assert found["/palm_pose"] != ["bytes"]
