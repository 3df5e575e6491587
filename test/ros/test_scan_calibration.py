"""The mapping node calibrates a scan in the background when recording pauses."""

import pytest
from support.hand import Hand
from support.sweeps import scene_of, write_scan

from tactile_localizer.core.scan.digest import digest_of
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scans.learned import stored_calibration
from tactile_localizer.io.scene_file import save_scene
from tactile_localizer.library import load_scan

pytestmark = pytest.mark.ros


@pytest.fixture
def files(tmp_path):
    save_scene(scene_of(), tmp_path / "scene.yaml")
    return {"scene_file": tmp_path / "scene.yaml", "scan_file": tmp_path / "bump_scan"}


def levels(arrays, name):
    return [status.level for array in arrays for status in array.status if status.name == name]


def test_calibration_blocks_no_service_and_loses_no_pair(node_process, probe, files):
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

    write_scan(files["scan_file"], calibrated=False)
    arrays = probe.listen(DiagnosticArray, "/diagnostics", 100)
    process = node_process("mapping_node", files)
    hand = Hand(probe, phalanges=("index", "middle"))
    process.wait_for_line("calibrating", timeout_s=30.0)
    assert hand.service("start_sweep").success
    hand.send_pose(0)
    for _ in range(50):  # 4 strain vectors each, at about 200 Hz
        hand.slide(20)
        probe.executor.spin_once(timeout_sec=0.02)
    hand.wait_for_stamp(1000)
    assert hand.service("end_sweep").success
    digest = digest_of(*load_scan(files["scan_file"]))
    probe.until(lambda: stored_calibration(files["scan_file"], digest), "the calibration", 120.0)
    assert levels(arrays, "mapping: calibration"), "its progress is in the diagnostics"
    assert set(levels(arrays, "mapping: calibration")) == {DiagnosticStatus.OK}
    assert process.stop() == 0
    assert "Traceback" not in process.output
    sweep = ScanFolder(files["scan_file"]).sweeps()[-1]
    assert (len(sweep), sweep.gaps, sweep.skipped) == (1000 // 5, 0, 0)


def test_a_scan_that_cannot_be_calibrated_is_a_warning(node_process, probe, files):
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

    write_scan(files["scan_file"], calibrated=False)
    arrays = probe.listen(DiagnosticArray, "/diagnostics", 100)
    process = node_process("mapping_node", files)
    probe.until(lambda: levels(arrays, "mapping: calibration"), "the first status")
    file = files["scan_file"] / "sweep_0003.npz"
    file.write_bytes(file.read_bytes()[:-100])
    warning = DiagnosticStatus.WARN
    probe.until(lambda: warning in levels(arrays, "mapping: calibration"), "the warning", 30.0)
    assert process.stop() == 0


def test_an_interrupt_ends_a_calibrating_node(node_process, files):
    write_scan(files["scan_file"], calibrated=False)
    process = node_process("mapping_node", files)
    process.wait_for_line("calibrating", timeout_s=60.0)
    assert process.stop() == 0
    assert "Traceback" not in process.output
    assert "not calibrated" not in process.output
