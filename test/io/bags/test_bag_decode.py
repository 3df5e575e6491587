"""Decoding many messages at once gives the same values as rosbags does for each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.bags import SCENE, pose, strain, write_bag

from tactile_localizer.channels import DEFAULT_CHANNELS
from tactile_localizer.core.geometry.palm_frame import PalmFrame
from tactile_localizer.errors import MeasurementError
from tactile_localizer.io.bags.decode import PoseDecoder, StrainDecoder
from tactile_localizer.io.bags.reader import read_messages, typestore
from tactile_localizer.scene import Axis, Phalanx, Scene

STORE = typestore()
STRAIN, POSE = StrainDecoder.kind, PoseDecoder.kind
AXES = (Axis("x", 0.0, 1.0), Axis("yaw", -1.0, 1.0), Axis("y", 0.0, 1.0))
stamps = st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 10**9 - 1))
names = st.lists(
    st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=9),
    max_size=4,
    unique=True,
)
frames = st.sampled_from(["base", "material", "é", ""])


def header(stamp: tuple[int, int], frame: str) -> Any:
    time = STORE.types["builtin_interfaces/msg/Time"](sec=stamp[0], nanosec=stamp[1])
    return STORE.types["std_msgs/msg/Header"](stamp=time, frame_id=frame)


def nanoseconds(stamp: tuple[int, int]) -> int:
    return stamp[0] * 10**9 + stamp[1]


def felt_by(phalanges: list[str], counts: list[int]) -> Scene:
    every = zip(phalanges, counts, strict=True)
    wanted = tuple(Phalanx(name, (0.0,), count) for name, count in every)[::-1]
    return Scene("sheet", AXES[:1], wanted or (Phalanx("none", (0.0,)),))


@pytest.mark.parametrize("channels", [(), (19, 1, 6, 400)])
@given(names.filter(bool), st.lists(st.tuples(stamps, frames, st.integers(-1, 1)), max_size=12))
def test_strains_decode_among_other_messages(
    channels: tuple[int, ...], phalanges: list[str], written: list[tuple[tuple[int, int], str, int]]
) -> None:
    n = len(phalanges)
    channels = channels[:n]
    counts = list(channels) or [DEFAULT_CHANNELS] * n
    size = sum(counts)
    raws, values = [], np.random.default_rng(0).normal(size=(len(written), size + 1))
    for (stamp, frame, odd), own in zip(written, values, strict=True):
        message = STORE.types[STRAIN](
            header=header(stamp, frame),
            phalanges=phalanges,
            strain=own[: size + odd],
            status=np.arange(n, dtype=np.uint8),
            sequence=np.zeros(n, np.uint32),
            channels=np.array(channels, np.uint16),
        )
        raws.append(bytes(STORE.serialize_cdr(message, STRAIN)))
    scene = felt_by(phalanges, counts)
    found = StrainDecoder(scene).of_bytes(raws)
    fits = np.array([odd == 0 for _, _, odd in written], dtype=bool)
    np.testing.assert_array_equal(found.valid, fits)
    expected = values[:, scene.channels(phalanges, counts)]
    np.testing.assert_array_equal(found.values[fits], expected[fits])
    np.testing.assert_array_equal(found.stamp_ns[fits], [nanoseconds(s) for s, _, odd in written if not odd])
    assert (found.status[fits] == np.arange(n)[::-1]).all()
    for row, raw in enumerate(raws):
        alone = StrainDecoder(scene).of_message(STORE.deserialize_cdr(raw, STRAIN))
        for one, many in zip(alone, found, strict=True):
            np.testing.assert_array_equal(one[0], many[row])


@given(
    st.lists(
        st.tuples(stamps, frames, st.lists(st.floats(width=64), min_size=7, max_size=7)),
        min_size=1,
        max_size=9,
    )
)
def test_poses_decode_as_one_by_one(
    written: list[tuple[tuple[int, int], str, list[float]]],
) -> None:
    frame = PalmFrame(AXES, "material", "base", [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    raws = []
    for stamp, name, numbers in written:
        place = STORE.types["geometry_msgs/msg/Point"](*numbers[:3])
        turn = STORE.types["geometry_msgs/msg/Quaternion"](*numbers[3:])
        message = STORE.types[POSE](header(stamp, name), STORE.types["geometry_msgs/msg/Pose"](place, turn))
        raws.append(bytes(STORE.serialize_cdr(message, POSE)))
    found = PoseDecoder(frame).of_bytes(raws)
    np.testing.assert_array_equal(found.stamp_ns, [nanoseconds(stamp) for stamp, _, _ in written])
    for row, (_, name, numbers) in enumerate(written):
        try:
            expected = frame.position(name, numbers[:3], numbers[3:])
        except MeasurementError:
            assert not found.valid[row]
            assert found.reason
        else:
            assert found.valid[row]
            np.testing.assert_allclose(found.position[row], expected, rtol=1e-12, atol=1e-12)
        alone = PoseDecoder(frame).of_message(STORE.deserialize_cdr(raws[row], POSE))
        assert alone.valid[0] == found.valid[row]
    assert found.valid.all() == (not found.reason)


def test_truncated_messages_are_skipped() -> None:
    raw = bytes(STORE.serialize_cdr(pose(50), POSE))
    raws = [raw, b"", *(raw[:cut] for cut in (2, 9, 20, 40)), b"\x00\x00" + raw[2:], raw]
    found = PoseDecoder(PalmFrame(SCENE.axes)).of_bytes(raws)
    assert found.valid.tolist() == [True, *[False] * 6, True]
    raw = bytes(STORE.serialize_cdr(strain(50), STRAIN))
    raws = [raw, b"", *(raw[:cut] for cut in range(2, len(raw) - 16, 7)), raw]
    found_strain = StrainDecoder(SCENE).of_bytes(raws)
    assert found_strain.valid.tolist() == [True, *[False] * (len(raws) - 2), True]


def test_other_definitions_are_not_decoded_from_bytes(tmp_path: Path) -> None:
    class Kind:
        kind = STRAIN

        def of_message(self, message: Any) -> str:
            return type(message).__name__

        def of_bytes(self, raws: Sequence[bytes]) -> str:
            return f"{len(raws)} of bytes"

    bag = write_bag(tmp_path / "bag", [("strain", 10, strain(10)), ("palm_pose", 10, pose(10))])
    found = read_messages(bag, {"/strain": Kind(), "/palm_pose": Kind()}).by_topic
    assert found["/strain"] == ["1 of bytes"]
    assert found["/palm_pose"] == ["geometry_msgs__msg__PoseStamped"]
