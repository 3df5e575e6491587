"""Messages of other sensors are converted to strain: a wrench fingertip and two taxel arrays."""

from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from std_msgs.msg import Float32MultiArray

from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.io.strain_vectors import StrainReader
from tactile_localizer.msg import StrainVectors
from tactile_localizer.ros.base.qos import STRAIN

EXAMPLE = Path(__file__).parents[2] / "examples/own_sensor"


def test_two_arrays_of_taxels_become_two_phalanges(node_process, probe):
    strain = probe.listen(StrainVectors, "strain", STRAIN)
    node_process("adapter_node", {"adapter_file": EXAMPLE / "array_adapter.yaml"})
    index, thumb = (probe.publisher(Float32MultiArray, f"{name}_taxels") for name in ("index", "thumb"))
    probe.known_to("tactile_adapter")

    def answer(data):
        """The strain vector of an array that differs from the others in its first taxel."""
        thumb.publish(Float32MultiArray(data=[8.0] * 16))
        index.publish(Float32MultiArray(data=data))
        return probe.until(
            lambda: next((message for message in strain if message.strain[0] == data[0]), None),
            f"the strain vector of {data}",
        )

    first, too_short, last = ([float(number), *map(float, range(1, 16))] for number in range(3))
    assert answer(first).header.stamp.sec > 0
    index.publish(Float32MultiArray(data=too_short[:15]))
    assert list(answer(last).channels) == [16, 16]
    assert [list(message.sequence) for message in strain] == [[1, 1], [2, 2]]


@pytest.mark.parametrize(
    ("entry", "reason"),
    [
        ("topic: a, type: no_such/msg/Skin, field: data", "type no_such/msg/Skin: expected an installed"),
        (
            "topic: a, type: Wrench, field: data",
            "type Wrench: expected an installed message type, found none",
        ),
        ("topic: a, type: /msg/Skin, field: data", "type /msg/Skin: expected an installed message type"),
        ("topic: a b, type: geometry_msgs/msg/WrenchStamped", "topic name"),
        (
            "topic: a, type: geometry_msgs/msg/Wrench, field: force.q",
            "field force.q: expected a field of geometry_msgs/msg/Wrench, found none",
        ),
    ],
)
def test_what_does_not_exist_is_rejected_in_one_line(refusal, tmp_path, entry, reason):
    (tmp_path / "own.yaml").write_text(f"phalanges: {{index: {{{entry}}}}}")
    (line,) = refusal("adapter_node", {"adapter_file": tmp_path / "own.yaml"})
    assert reason in line


def test_a_fingertip_is_reported_while_it_is_silent(node_process, probe):
    reports = probe.diagnostics()
    strain = probe.listen(StrainVectors, "strain", STRAIN)
    node_process("adapter_node", {"adapter_file": EXAMPLE / "fingertip_adapter.yaml"})
    messages = lambda: [report.status[0].message for report in reports]  # noqa: E731
    probe.until(lambda: "no messages on wrench" in messages(), "the report")
    wrenches, wrench = probe.publisher(WrenchStamped, "wrench"), WrenchStamped()
    wrench.header.stamp.sec, wrench.wrench.force.x, wrench.wrench.torque.z = 1, 2.0, 3.0

    def publish():
        wrenches.publish(wrench)
        return messages()

    stopped = "messages have stamps that do not increase, and are left out"
    probe.until(
        lambda: any(stopped in each for each in publish()), "the report of stamps that do not increase"
    )

    def go_on():
        wrench.header.stamp = probe.node.get_clock().now().to_msg()
        return publish()

    probe.until(lambda: "OK" in go_on(), "the end of the report")
    read, status = StrainReader(load_scene(EXAMPLE / "fingertip.yaml")).read(strain[-1])
    np.testing.assert_array_equal(read, [2.0, 0.0, 0.0, 0.0, 0.0, 3.0])
    assert status.tolist() == [0]


def test_two_sensors_on_one_topic_are_an_error_with_their_frames(node_process, probe):
    reports = probe.diagnostics()
    strain = probe.listen(StrainVectors, "strain", STRAIN)
    node_process("adapter_node", {"adapter_file": EXAMPLE / "fingertip_adapter.yaml"})
    sensors = [probe.publisher(WrenchStamped, "wrench") for _ in range(2)]

    def publish():
        for number, sensor in enumerate(sensors):
            message = WrenchStamped()
            message.header.stamp = probe.node.get_clock().now().to_msg()
            message.header.frame_id = ("left_ft", "right_ft")[number]
            message.wrench.force.x = 10.0 * number
            sensor.publish(message)

    def reported():
        publish()
        found = [each.status[0] for each in reports]
        text = "expected one publisher of wrench, found 2 (frames left_ft, right_ft); "
        return next((each for each in found if each.message.startswith(text)), None)

    assert probe.until(reported, "the report").level == b"\x02"
    assert len({vector.strain[0] for vector in strain}) == 1, "one of them is taken"


def test_a_value_that_is_never_there_is_named_live(node_process, probe, tmp_path):
    adapter = tmp_path / "skin.yaml"
    adapter.write_text(
        "phalanges: {finger: {topic: /skin, type: std_msgs/msg/Float32MultiArray, channels: 3}}"
    )
    reports = probe.diagnostics()
    node_process("adapter_node", {"adapter_file": adapter})
    skin = probe.publisher(Float32MultiArray, "/skin")
    text = "/skin: value 3 of finger is never a number; values: [0..1] in the adapter"
    probe.until(
        lambda: (
            skin.publish(Float32MultiArray(data=[1.0, 2.0, float("nan")]))
            or [each for each in reports if each.status[0].message.startswith(text)]
        ),
        "the report",
    )
