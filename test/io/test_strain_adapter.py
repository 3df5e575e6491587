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


def test_late_messages_are_skipped():
    made = adapter(index={"topic": "a", "type": WRENCH})
    stamps = [5000, 5010, 5010, 5005, 4600, 5020, 10]
    assert [made.feed("a", wrench(s, *[0] * 6), 0) is not None for s in stamps] == [
        True, True, False, False, False, True, True,
    ]  # fmt: skip


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
