"""Messages of other sensors are converted to strain: a wrench fingertip and two taxel arrays."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from support.bags import MS, START

from tactile_localizer.io.scans.folder import ScanFolder

pytestmark = pytest.mark.ros

EXAMPLE = Path(__file__).parents[2] / "examples/own_sensor"


def place_at(stamp_ms):
    """Position at a time: back and forth within the bounds."""
    return 0.01 + 1e-5 * abs(stamp_ms % 4000 - 2000)


def channels_at(x, count):
    return np.sin(100 * x + np.arange(count))


def wrench(stamp_ms):
    from geometry_msgs.msg import WrenchStamped

    message = WrenchStamped()
    values = channels_at(place_at(stamp_ms), 6).tolist()
    for name, value in zip("xyz", values[:3], strict=True):
        setattr(message.wrench.force, name, value)
    for name, value in zip("xyz", values[3:], strict=True):
        setattr(message.wrench.torque, name, value)
    _stamp(message, stamp_ms)
    return message


def pose(stamp_ms):
    from geometry_msgs.msg import PoseStamped

    message = PoseStamped()
    message.header.frame_id = "material"
    message.pose.position.x = place_at(stamp_ms)
    message.pose.orientation.w = 1.0
    _stamp(message, stamp_ms)
    return message


def _stamp(message, stamp_ms):
    seconds, message.header.stamp.nanosec = divmod(START + stamp_ms * MS, 10**9)
    message.header.stamp.sec = seconds


def test_a_wrench_fingertip_is_mapped(node_process, probe, tmp_path):
    from geometry_msgs.msg import PoseStamped, WrenchStamped
    from std_srvs.srv import Trigger

    from tactile_localizer.msg import ScanStatus, StrainVectors
    from tactile_localizer.ros.base.qos import STRAIN

    strain = probe.listen(StrainVectors, "strain", STRAIN)
    node_process("adapter_node", {"adapter_file": EXAMPLE / "fingertip_adapter.yaml"})
    files = {"scene_file": EXAMPLE / "fingertip.yaml", "scan_file": tmp_path / "bump_scan"}
    mapping = node_process("mapping_node", files)
    wrenches, poses = probe.publisher(WrenchStamped, "wrench"), probe.publisher(PoseStamped, "palm_pose", 100)
    statuses = probe.listen(ScanStatus, "mapping/status", 10)
    assert probe.call(Trigger, "mapping/start_sweep").success
    stamps_ms = itertools.count(10, 10)

    def recorded():
        stamp_ms = next(stamps_ms)
        poses.publish(pose(stamp_ms))
        wrenches.publish(wrench(stamp_ms))
        return statuses and statuses[-1].samples > 30

    probe.until(recorded, "pairs in the scan", timeout_s=30.0)
    assert probe.call(Trigger, "mapping/end_sweep").success
    assert mapping.stop() == 0
    assert list(strain[-1].channels) == [6]
    store = ScanFolder(files["scan_file"])
    scan = store.load()
    expected = np.array([channels_at(x, 6) for x in scan.states[:, 0]])
    np.testing.assert_allclose(scan.strain, expected, atol=1e-9)


def test_two_arrays_of_taxels_become_two_phalanges(node_process, probe):
    from std_msgs.msg import Float32MultiArray

    from tactile_localizer.msg import StrainVectors
    from tactile_localizer.ros.base.qos import STRAIN

    strain = probe.listen(StrainVectors, "strain", STRAIN)
    node_process("adapter_node", {"adapter_file": EXAMPLE / "array_adapter.yaml"})
    index, thumb = (probe.publisher(Float32MultiArray, f"{name}_taxels") for name in ("index", "thumb"))
    probe.known_to("adapter")

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


def test_a_silent_sensor_is_reported(node_process, probe):
    from geometry_msgs.msg import WrenchStamped

    reports = probe.diagnostics()
    node_process("adapter_node", {"adapter_file": "wrench.yaml"})
    messages = lambda: [report.status[0].message for report in reports]  # noqa: E731
    probe.until(lambda: "no messages on /wrench" in messages(), "the report")
    wrenches = probe.publisher(WrenchStamped, "wrench")
    probe.until(lambda: wrenches.publish(WrenchStamped()) or "OK" in messages(), "the end of the report")
