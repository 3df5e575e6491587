"""The nodes as a lifecycle manager sees them: requests are answered, whatever the node is doing."""

import pytest
from support.filter import CELL
from support.sweeps import write_scan

pytestmark = pytest.mark.ros


@pytest.fixture
def change(probe):
    """``change(node, transition)``: whether a node made a transition."""
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState

    def ask(node, transition):
        number = getattr(Transition, f"TRANSITION_{transition.upper()}")
        request = ChangeState.Request(transition=Transition(id=number))
        return probe.call(ChangeState, f"{node}/change_state", request, timeout_s=120.0).success

    return ask


def state_of(probe, node):
    from lifecycle_msgs.srv import GetState

    return probe.call(GetState, f"{node}/get_state").current_state.label


def led(node_process, tmp_path, *, calibrated=True):
    """A filter that waits for a manager; unless its scan is ``calibrated``, that is still to be done."""
    scan = tmp_path / "bump.db"
    if not scan.exists():
        write_scan(scan, calibrated=calibrated)
    return node_process("filter_node", {"scan_file": scan, "autostart": False, **CELL})


def test_a_transition_that_the_state_does_not_have_is_refused(node_process, probe, change, tmp_path):
    process = led(node_process, tmp_path)
    assert not change("filter", "activate")
    process.wait_for_line("transition 3")
    assert state_of(probe, "filter") == "unconfigured"
    assert change("filter", "configure")
    assert not change("filter", "configure")
    assert change("filter", "activate")
    assert state_of(probe, "filter") == "active"


def test_services_answer_and_progress_is_published_while_a_scan_is_calibrated(
    node_process, probe, change, tmp_path
):
    from diagnostic_msgs.msg import DiagnosticArray
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState

    told = probe.listen(DiagnosticArray, "/diagnostics")
    process = led(node_process, tmp_path, calibrated=False)
    client = probe.node.create_client(ChangeState, "filter/change_state")
    probe.until(client.service_is_ready, "the filter", 60.0)
    configure = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_CONFIGURE))
    answer = client.call_async(configure)
    assert state_of(probe, "filter") == "configuring"
    assert not change("filter", "configure"), "one transition at a time"
    probe.until(lambda: told, "progress")
    assert not answer.done()
    assert told[0].status[0].name == "filter: map"
    probe.until(answer.done, "the end of the calibration", 180.0)
    assert answer.result().success
    assert any("map built: 100%" in array.status[0].message for array in told)
    assert process.stop() == 0


def test_a_scan_is_calibrated_once(node_process, probe, change, tmp_path):
    for is_calibrated in (True, False):
        process = led(node_process, tmp_path, calibrated=False)
        assert change("filter", "configure")
        assert ("calibrating on held-out sweeps" in process.output) is is_calibrated
        assert process.stop() == 0


def test_an_interrupt_while_a_scan_is_calibrated_ends_the_node(node_process, probe, tmp_path):
    scan = tmp_path / "bump.db"
    write_scan(scan, calibrated=False)
    process = node_process("filter_node", {"scan_file": scan, **CELL})
    probe.until(lambda: state_of(probe, "filter") == "configuring", "the calibration")
    assert process.stop() == 0
    assert "Traceback" not in process.output


def test_nothing_is_published_unless_active(node_process, probe, change, tmp_path):
    from rclpy.qos import DurabilityPolicy, QoSProfile

    from tactile_localizer.msg import ScanStatus

    kept = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    statuses = probe.listen(ScanStatus, "mapping/status", kept)
    parameters = {"scan_file": tmp_path / "scan.db", "scene_file": "bump.yaml", "autostart": False}
    node_process("mapping_node", parameters)
    assert change("mapping", "configure")
    probe.until(lambda: probe.node.count_publishers("mapping/status"), "the publisher")
    probe.known_to("mapping")
    assert not statuses
    assert change("mapping", "activate")
    probe.until(lambda: statuses, "a status")
    assert change("mapping", "deactivate")
    probe.known_to("mapping")
    statuses.clear()
    probe.known_to("mapping")
    assert not statuses
