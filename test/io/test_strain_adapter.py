"""Strain vectors from wrenches and arrays of numbers."""

from types import SimpleNamespace as Message

import numpy as np
import pytest

from tactile_localizer.errors import MeasurementError, ParameterError
from tactile_localizer.io.bags.reader import typestore
from tactile_localizer.io.status import MISSING, OK
from tactile_localizer.io.strain_adapter import adapter_from_dict, load_adapter

ARRAY = "std_msgs/msg/Float64MultiArray"
WRENCH = "geometry_msgs/msg/WrenchStamped"
MS = 1_000_000


def adapter(max_age_s=0.05, **phalanges):
    return adapter_from_dict({"phalanges": phalanges, "max_age_s": max_age_s})


def wrench(stamp_ms, *values):
    stamp = Message(sec=stamp_ms // 1000, nanosec=stamp_ms % 1000 * MS)
    force, torque = (Message(x=x, y=y, z=z) for x, y, z in (values[:3], values[3:]))
    return Message(header=Message(stamp=stamp), wrench=Message(force=force, torque=torque))


def image(encoding, pixels):
    """An image of one row."""
    data = np.frombuffer(pixels.tobytes(), np.uint8)
    size = {"height": 1, "width": len(pixels), "step": len(data)}
    return Message(encoding=encoding, is_bigendian=0, data=data, **size)


def test_a_wrench_has_six_channels():
    made = adapter(index={"topic": "ft", "type": WRENCH, "scale": 2.0})
    vector = made.feed("ft", wrench(1500, 1, 2, 3, 4, 5, 6), 7)
    assert (vector.stamp_ns, vector.status.tolist()) == (1500 * MS, [OK])
    np.testing.assert_array_equal(vector.strain, [2, 4, 6, 8, 10, 12])


def test_an_array_is_found_by_its_nested_field():
    entry = {"topic": "skin", "type": "own/msg/Skin", "field": "pressure.values", "channels": 2}
    made, values = adapter(index=entry), ([0.0, 0.5], [0.0, np.nan])
    vectors = [
        made.feed("skin", Message(pressure=Message(values=one)), k) for k, one in enumerate(values, start=1)
    ]
    assert [vector.stamp_ns for vector in vectors] == [1, 2], "without a header, the time of receipt"
    np.testing.assert_array_equal([vector.strain for vector in vectors], [[0.0, 0.5], [np.nan] * 2])
    assert [vector.status.tolist() for vector in vectors] == [[OK], [MISSING]]


def test_a_field_of_each_element_of_an_array_is_a_channel():
    """As drivers of skins publish it: an array of sensors, each with an array of taxels."""

    def fed(field, channels, rows):
        entry = {"topic": "a", "type": "own/msg/Skin", "field": field, "channels": channels}
        return adapter(index=entry).feed("a", Message(rows=rows), 1).strain.tolist()

    vectors = [[Message(force=Message(x=0.0, z=10.0 * row + k)) for k in range(2)] for row in range(3)]
    rows = [Message(taxels=taxels) for taxels in vectors]
    assert fed("rows.taxels.force.z", 6, rows) == [0, 1, 10, 11, 20, 21]
    assert fed("rows.2.taxels.force.z", 2, rows) == [20, 21]
    assert fed("rows.taxels.1.force.z", 3, rows) == [1, 11, 21]
    arrays = [Message(values=np.arange(2.0) + row) for row in range(2)] + [Message(values=[7.0])]
    assert fed("rows.values", 5, arrays) == [0, 1, 1, 2, 7]
    with pytest.raises(MeasurementError, match="expected 5 channels for phalanx index, got 0"):
        fed("rows.values", 5, [])
    for field in ("rows.value", "rows.3.values", "rows.values.x"):
        with pytest.raises(MeasurementError, match=f"expected numbers in field {field}"):
            fed(field, 5, arrays)


def test_a_message_of_numbers_has_a_channel_for_each_of_its_fields():
    """As ``Vector3``, alone or in arrays; from rclpy, whose messages have slots, or from rosbags."""

    class Received:
        __slots__ = ("_x", "_y", "_z")
        x, y, z = 4.0, 5.0, 6.0

        def get_fields_and_field_types(self):
            return {"x": "double", "y": "double", "z": "double"}

    def fed(field, channels, **fields):
        entry = {"topic": "a", "type": "own/msg/Skin", "field": field, "channels": channels}
        return adapter(index=entry).feed("a", Message(**fields), 1).strain.tolist()

    vectors = [typestore().types["geometry_msgs/msg/Vector3"](x=1.0, y=2.0, z=3.0), Received()]
    assert fed("force", 3, force=vectors[1]) == [4, 5, 6]
    assert fed("taxels", 6, taxels=vectors) == [1, 2, 3, 4, 5, 6]
    assert fed("rows.taxels", 12, rows=[Message(taxels=vectors)] * 2) == [1, 2, 3, 4, 5, 6] * 2
    with pytest.raises(MeasurementError, match="expected numbers in field named"):
        fed("named", 2, named=Message(name="pad", x=1.0))


def test_other_phalanges_contribute_recent_values():
    entry = {"type": WRENCH}
    made = adapter(index={**entry, "topic": "a"}, thumb={**entry, "topic": "b"})

    def felt(stamp_ms):
        vector = made.feed("a", wrench(stamp_ms, *[0] * 6), 0)
        return vector.strain[6] if vector.status[1] == OK else None

    assert felt(1) is None
    for stamp_ms in (5, 20):
        assert made.feed("b", wrench(stamp_ms, *[stamp_ms] * 6), 0) is None
    assert [felt(stamp_ms) for stamp_ms in (12, 20, 69, 71)] == [20, 20, 20, None]


def test_values_from_the_future_are_as_far_as_old_ones():
    """Where a sensor's clock is ahead, its values do not belong to those of the first phalanx."""
    made = adapter(index={"topic": "a", "type": WRENCH}, thumb={"topic": "b", "type": WRENCH})
    made.feed("b", wrench(1000, *[7] * 6), 0)
    status = [made.feed("a", wrench(ms, *[0] * 6), 0).status[1] for ms in (900, 940, 960, 1040, 1060)]
    assert status == [MISSING, MISSING, OK, OK, MISSING]


def test_late_messages_are_skipped():
    made = adapter(index={"topic": "a", "type": WRENCH})
    stamps = [5000, 5010, 5010, 5005, 4600, 5020, 10]
    assert [made.feed("a", wrench(s, *[0] * 6), 0) is not None for s in stamps] == [
        True, True, False, False, False, True, True,
    ]  # fmt: skip
    (found,) = made.findings()
    assert found.startswith(
        "a: 3 of 7 messages have stamps that do not increase, and are left out; stamp: rec"
    )
    assert made.findings() == []


@pytest.mark.parametrize(
    ("entry", "first", "other"),
    [
        (
            {"type": ARRAY, "values": [0, 1]},
            Message(data=[1.0, 2.0, 3.0]),
            Message(data=[9.0, 1.0, 2.0, 3.0]),
        ),
        (
            {"type": "sensor_msgs/msg/Image", "channels": 2},
            image("16UC1", np.array([1, 2], np.uint16)),
            image("32FC1", np.array([1, 2], np.float32)),
        ),
    ],
)
def test_values_of_another_form_are_refused(entry, first, other):
    made = adapter(index={"topic": "a", **entry})
    assert made.feed("a", first, 1).strain.tolist() == [1.0, 2.0]
    with pytest.raises(MeasurementError, match=r"a: expected . values.* as before, found . values"):
        made.feed("a", other, 2)
    assert made.feed("a", first, 3).strain.tolist() == [1.0, 2.0]


JOINTS = {"topic": "/joint_states", "type": "sensor_msgs/msg/JointState", "field": "effort"}


def joints(names, efforts, stamp_ms=1):
    stamp = Message(sec=stamp_ms // 1000, nanosec=stamp_ms % 1000 * MS)
    return Message(
        header=Message(stamp=stamp, frame_id=""), name=[*names], position=[], effort=np.array(efforts, float)
    )


def test_values_are_taken_by_the_names_in_the_message():
    made = adapter(hand={**JOINTS, "names": ["joint_0..2"]})
    messages = [
        joints(["joint_0", "joint_1", "joint_2"], [0, 1, 2], 1),
        joints(["joint_2", "joint_0", "joint_1"], [2, 0, 1], 2),
        joints(["arm", "joint_1", "joint_0", "joint_2", "base"], [9, 1, 0, 2, 8], 3),
    ]
    for message in messages:
        assert made.feed("/joint_states", message, 1).strain.tolist() == [0, 1, 2]
    assert made.feed("/joint_states", joints(["arm", "base"], [9, 8]), 1) is None, "another device"
    with pytest.raises(
        MeasurementError, match="/joint_states: expected a value named joint_2, found joint_0, joint_1"
    ):
        made.feed("/joint_states", joints(["joint_0", "joint_1"], [0, 1]), 1)
    assert made.findings() == []
    assert made.feed("/joint_states", joints(["arm"], [9]), 1) is None
    (finding,) = made.findings()
    assert finding == "/joint_states: expected names joint_0, joint_1, joint_2 for phalanx hand, found arm"


def test_names_that_change_are_an_error_without_a_list():
    made = adapter(hand={**JOINTS, "channels": 2})
    assert made.feed("/joint_states", joints("ab", [0, 1], 1), 1).strain.tolist() == [0, 1]
    with pytest.raises(
        MeasurementError, match=r"expected names a, b, found b, a; names: \[a, b\] in the adapter"
    ):
        made.feed("/joint_states", joints("ba", [1, 0], 2), 1)
    assert "names: [a, b] takes them by name" in made.findings()[-1]
    known = made.expect({"hand": ["a", "b"]})
    assert known.feed("/joint_states", joints("ba", [1, 0], 2), 1).strain.tolist() == [0, 1]


def test_names_may_be_in_each_message_of_an_array_or_beside_it():
    def fed(field, names, **fields):
        entry = {"topic": "a", "type": "own/msg/Skin", "field": field, "names": names}
        return adapter(index=entry).feed("a", Message(**fields), 1).strain.tolist()

    pads = [Message(name=name, value=value) for name, value in (("tip", 3.0), ("base", 4.0))]
    assert fed("pads.value", ["base", "tip"], pads=pads) == [4, 3]
    states = [Message(interface_names=["effort", "position"], values=[10.0 * n, 5.0]) for n in range(2)]
    names = ["j1/effort", "j0/effort"]
    assert fed("states.values", names, joint_names=["j0", "j1"], states=states) == [10, 0]


@pytest.mark.parametrize(
    ("keys", "taken"),
    [
        ({"values": ["0..2"]}, [0, 1, 2]),
        ({"values": "1, 3..4"}, [1, 3, 4]),
        ({"values": [4, 0]}, [4, 0]),
        ({"values": 2}, [2]),
        ({"field": "data.1..3 * 10", "channels": 3}, [10, 20, 30]),
    ],
)
def test_values_may_be_left_out(keys, taken):
    made = adapter(index={"topic": "a", "type": ARRAY, **keys})
    assert made.feed("a", Message(data=np.arange(5.0)), 1).strain.tolist() == taken


def test_several_fields_are_named_as_columns_are():
    entry = {"topic": "a", "type": "own/msg/Tip", "field": "pac_0..1, electrodes", "channels": 4, "scale": 2}
    message = Message(pac_0=1, pac_1=2, electrodes=np.array([3, 4], np.int16))
    assert adapter(index=entry).feed("a", message, 1).strain.tolist() == [2, 4, 6, 8]


def test_a_value_that_is_never_there_is_named():
    entry = {"topic": "/skin", "type": ARRAY, "channels": 4}
    made, kept = adapter(finger=entry), adapter(finger={**entry, "values": ["0..1", 3], "channels": 3})
    for n in range(1, 9):
        message = Message(data=[1.0, float("nan") if n == 5 else 2.0, float("nan"), 4.0])
        assert made.feed("/skin", message, n).status[0] == MISSING
        assert (kept.feed("/skin", message, n).status[0] == OK) == (n != 5)
    (finding,) = made.findings()
    assert finding.startswith("/skin: value 3 of finger is never a number; values: [0..1, 3] in the adapter")
    assert kept.findings() == ["/skin: no number in finger_2 (1 of 8 messages)"]
    assert made.findings() == [], "since the last call"


def test_an_array_that_is_empty_at_rest_may_have_a_value():
    entry = {"topic": "a", "type": "own/msg/Contacts", "field": "states.0.force", "channels": 3}
    force = Message(x=1.0, y=2.0, z=3.0)
    fed = lambda entry, states: adapter(index=entry).feed("a", Message(states=states), 1).strain.tolist()  # noqa: E731
    for field in ("states.force", "states.0.force"):
        each = {**entry, "field": field, "empty": 0}
        assert fed(each, []) == [0, 0, 0]
        assert fed(each, [Message(force=force)]) == [1, 2, 3]
    with pytest.raises(MeasurementError):
        fed(entry, [])
    with pytest.raises(MeasurementError, match=r"expected numbers in field states\.0\.farce"):
        fed({**entry, "field": "states.0.farce", "empty": 0}, [Message(force=force)])


@pytest.mark.parametrize("is_bigendian", [False, True])
@pytest.mark.parametrize(
    ("encoding", "kind"),
    [("mono8", "u1"), ("8UC1", "u1"), ("8SC1", "i1"), ("16UC1", "u2"), ("mono16", "u2"), ("16SC1", "i2"),
     ("32SC1", "i4"), ("32FC1", "f4"), ("64FC1", "f8"), ("16UC2", "u2"), ("rgb8", "u1")],
)  # fmt: skip
def test_pixels_of_an_image_are_read_by_its_encoding(encoding, kind, is_bigendian):
    channels = {"16UC2": 2, "rgb8": 3}.get(encoding, 1)
    values = np.array([0, 1, 100, -3 if kind[0] != "u" else 200] * 3 * channels)[: 6 * channels]
    rows = values.reshape(2, -1).astype(f"{'>' if is_bigendian else '<'}{kind}")
    padded = [row.tobytes() + b"\xff" * 5 for row in rows]  # a step may be longer than a row
    image = typestore().types["sensor_msgs/msg/Image"](
        header=None, height=2, width=3, encoding=encoding, is_bigendian=int(is_bigendian),
        step=len(padded[0]), data=np.frombuffer(b"".join(padded), np.uint8),
    )  # fmt: skip
    entry = {"topic": "/skin", "type": "sensor_msgs/msg/Image", "channels": len(values)}
    np.testing.assert_array_equal(adapter(index=entry).feed("/skin", image, 1).strain, values)
    match = rf"/skin: expected 99 channels .* got {len(values)} \(2 rows of 3 pixels of encoding {encoding}"
    with pytest.raises(MeasurementError, match=match):
        adapter(index={**entry, "channels": 99}).feed("/skin", image, 1)
    image.data = image.data[:-1]
    with pytest.raises(MeasurementError, match="/skin: expected 2 rows of 3 pixels"):
        adapter(index=entry).feed("/skin", image, 1)
    image.encoding = "yuv422"
    with pytest.raises(
        MeasurementError, match="/skin: expected encoding mono8, 16UC1 or alike, found 'yuv422'"
    ):
        adapter(index=entry).feed("/skin", image, 1)


def test_bytes_of_other_messages_are_no_values():
    types = typestore().types
    fields = [
        Message(name="x", offset=0, datatype=7, count=1),
        Message(name="force", offset=6, datatype=4, count=1),
    ]
    data = np.array([(1.5, 0, 7), (2.5, 0, 65535)], "<f4,u2,u2").view(np.uint8)
    cloud = Message(
        fields=fields, height=1, width=2, point_step=8, row_step=16, is_bigendian=False, data=data,
        header=Message(stamp=Message(sec=1, nanosec=0)),
    )  # fmt: skip
    entry = {"topic": "a", "type": "sensor_msgs/msg/PointCloud2", "channels": 2}
    assert adapter(index={**entry, "field": "force"}).feed("a", cloud, 1).strain.tolist() == [7, 65535]
    assert adapter(index={**entry, "field": "x"}).feed("a", cloud, 1).strain.tolist() == [1.5, 2.5]
    with pytest.raises(MeasurementError, match="a: expected one of x, force, which the points have"):
        adapter(index={**entry, "field": "data"}).feed("a", cloud, 1)
    packed = types["sensor_msgs/msg/CompressedImage"](header=None, format="png", data=data)
    with pytest.raises(MeasurementError, match="found 'png' bytes, which are compressed"):
        adapter(index={**entry, "field": "data"}).feed("a", packed, 1)
    octets = {"topic": "a", "type": "std_msgs/msg/ByteMultiArray", "channels": 2}
    assert adapter(index=octets).feed("a", Message(data=[b"1", b"\x02"]), 1).strain.tolist() == [49, 2]


def test_the_stamp_of_a_sensor_that_counts_from_its_start_may_be_that_of_receipt():
    now_ns = 1_732_550_400 * 10**9
    for made in (
        adapter(index={"topic": "a", "type": WRENCH, "stamp": "receipt"}),
        adapter_from_dict({"stamp": "receipt", "phalanges": {"index": {"topic": "a", "type": WRENCH}}}),
    ):
        assert made.feed("a", wrench(100, *[0] * 6), now_ns).stamp_ns == now_ns
    made = adapter(index={"topic": "a", "type": WRENCH})
    assert made.feed("a", wrench(100, *[0] * 6), now_ns).stamp_ns == 100 * MS
    assert made.ahead_ns["a"] == 100 * MS - now_ns


def test_one_of_two_sensors_on_a_topic_is_taken_and_both_are_named():
    def felt(made, frame, force, ms):
        message = wrench(ms, force, 0, 0, 0, 0, 0)
        message.header.frame_id = frame
        vector = made.feed("/wrench", message, ms * MS)
        return vector and vector.strain[0]

    entry = {"topic": "/wrench", "type": WRENCH}
    made = adapter(index=entry)
    assert made.mixed("/wrench", ["/a", "/b"]).endswith("found 2 (nodes /a, /b)"), "before any message"
    taken = [felt(made, ("left_ft", "right_ft")[n % 2], 10.0 * (n % 2), 10 * n) for n in range(1, 20)]
    assert {each for each in taken if each is not None} == {10.0}, "that which came first"
    text = "expected one source of /wrench, found 2 (frames left_ft, right_ft); right_ft is taken"
    assert made.mixed("/wrench").startswith(text)
    assert made.mixed("/wrench", ["/a", "/b"]).startswith(
        "expected one publisher of /wrench, found 2 (frames"
    )
    assert felt(made, "left_ft", 0.0, 2000) == 0.0, "the other one has stopped"
    made.findings()
    felt(made, "left_ft", 0.0, 2010)
    assert made.mixed("/wrench", ["/a", "/b"]) == "expected one publisher of /wrench, found 2 (nodes /a, /b)"
    chosen = adapter(index={**entry, "frame": "left_ft"}, thumb={**entry, "frame": "right_ft"})
    felt(chosen, "right_ft", 10.0, 1)
    assert felt(chosen, "left_ft", 3.0, 2) == 3.0
    assert chosen.mixed("/wrench", ["/a", "/b"]) == ""
    absent = adapter(index={**entry, "frame": "middle_ft"})
    assert felt(absent, "left_ft", 3.0, 2) is None
    assert absent.findings() == ["/wrench: expected frame middle_ft for phalanx index, found left_ft"]


@pytest.mark.parametrize(
    "message", [Message(data=[1.0] * 3), Message(points=[1.0]), Message(data=None), Message(data=["one", 2])]
)
def test_messages_without_the_values_are_refused(message):
    made = adapter(index={"topic": "skin", "type": ARRAY, "channels": 2})
    with pytest.raises(MeasurementError, match=r"skin: expected (2 channels|numbers in field data)"):
        made.feed("skin", message, 1)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"type": ARRAY}, "phalanx index: expected topic, found none"),
        ({"topic": "a"}, "phalanx index: expected type, found none"),
        (
            {"topic": "a", "type": "geometry_msgs/msg/WrenchStampd"},
            "WrenchStampd' with a field.*did you mean geometry_msgs/msg/WrenchStamped",
        ),
        ({"topic": "a", "type": ARRAY, "channels": 0}, "channels: expected"),
        ({"topic": "a", "type": ARRAY, "scale": "big"}, "scale: expected"),
        (
            {"topic": "a", "type": ARRAY, "values": ["a"]},
            r"values: expected numbers from 0, as in \[0..5, 7\]",
        ),
        ({"topic": "a", "type": ARRAY, "values": [1, 1]}, "values: expected each once"),
        (
            {"topic": "a", "type": ARRAY, "values": [1, 2], "channels": 3},
            "channels: expected 2, as many as values",
        ),
        (
            {"topic": "a", "type": ARRAY, "values": [1], "names": ["b"]},
            "expected names or values, found both",
        ),
        ({"topic": "a", "type": ARRAY, "names": [{"b": 1}]}, "names: expected a name or a list of names"),
        ({"topic": "a", "type": ARRAY, "stamp": "now"}, "stamp: expected header or receipt, got 'now'"),
        ({"topic": "a", "type": ARRAY, "empty": "no"}, "empty: expected"),
        ({"topic": "a", "type": ARRAY, "field": "data * x"}, "field: expected a number after"),
        ({"topic": "a", "type": ARRAY, "filter": 3}, "phalanx index: expected one of topic, type"),
    ],
)
def test_invalid_entries_are_refused(entry, message):
    with pytest.raises(ParameterError, match=message):
        adapter(index=entry)


def test_a_topic_has_one_type():
    with pytest.raises(ParameterError, match=f"topic a: expected one type, got {WRENCH}, {ARRAY}"):
        adapter(index={"topic": "a", "type": WRENCH}, thumb={"topic": "a", "type": ARRAY})


def test_a_missing_adapter_file_is_named(tmp_path):
    with pytest.raises(ParameterError, match=r"none\.yaml: expected a strain adapter in YAML, found none"):
        load_adapter(tmp_path / "none.yaml")
