"""Requests of a lifecycle manager are answered in every state."""

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from support.filter import CELL
from support.sweeps import write_scan

from tactile_localizer.msg import ScanStatus


def state_of(probe, node):
    return probe.call(GetState, f"{node}/get_state").current_state.label


@pytest.fixture
def uncalibrated(tmp_path):
    """A small scan without a stored calibration."""
    write_scan(tmp_path / "bump_scan", calibrated=False, short=True)
    return tmp_path / "bump_scan"


def test_an_invalid_transition_is_rejected(node_process, probe, valid):
    process = node_process("filter_node", {**valid["filter"], "autostart": False})
    assert not probe.change("tactile_filter", "activate")
    process.wait_for_line("transition 3")
    assert state_of(probe, "tactile_filter") == "unconfigured"
    assert probe.change("tactile_filter", "configure")
    assert not probe.change("tactile_filter", "configure")
    assert probe.change("tactile_filter", "activate")
    assert state_of(probe, "tactile_filter") == "active"


def test_calibrating_blocks_no_service_and_reports_progress(node_process, probe, uncalibrated):
    reports = probe.diagnostics()
    process = node_process("filter_node", {"scan_file": uncalibrated, "autostart": False, **CELL})
    client = probe.node.create_client(ChangeState, "tactile_filter/change_state")
    probe.until(client.service_is_ready, "the filter")
    probe.known_to("tactile_filter")
    configure = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_CONFIGURE))
    answer = client.call_async(configure)
    probe.until(lambda: state_of(probe, "tactile_filter") == "configuring", "the calibration")
    assert not probe.change("tactile_filter", "configure"), "one transition at a time"
    probe.until(answer.done, "the end of the calibration", 180.0)
    assert "examining the scan by held-out sweeps: 18%" in process.output
    assert answer.result().success
    probe.until(lambda: any("ready: 100%" in array.status[0].message for array in reports), "100 %")
    values = [value for array in reports for status in array.status for value in status.values]
    fractions = [float(value.value) for value in values if value.key == "fraction"]
    assert fractions == sorted(fractions), "one bar"
    assert reports[0].status[0].name == "tactile_filter: map"
    assert process.stop() == 0


def test_an_interrupt_ends_a_calibrating_node(node_process, uncalibrated):
    process = node_process("filter_node", {"scan_file": uncalibrated, **CELL})
    process.wait_for_line("learning the noise")
    assert process.stop() == 0
    assert "Traceback" not in process.output


def test_inactive_nodes_publish_nothing(node_process, probe, valid):
    statuses = probe.listen(ScanStatus, "tactile_mapping/status", probe.latched)
    node_process("mapping_node", {**valid["mapping"], "autostart": False})
    assert probe.change("tactile_mapping", "configure")
    probe.until(lambda: probe.node.count_publishers("tactile_mapping/status"), "the publisher")
    probe.known_to("tactile_mapping")
    assert not statuses
    assert probe.change("tactile_mapping", "activate")
    probe.until(lambda: statuses, "a status")
    assert probe.change("tactile_mapping", "deactivate")
    probe.known_to("tactile_mapping")
    statuses.clear()
    probe.known_to("tactile_mapping")
    assert not statuses
