"""The mapping node records sweeps of strain and positions, by stamps."""

import resource
import signal

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import PointCloud2
from support.bags import MS, START, x_at
from support.hand import stamp_of

from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scans.writer import ScanWriter
from tactile_localizer.scene import Axis, Phalanx, Scene


def load(files):
    store = ScanFolder(files["scan_file"])
    return store.load(), store.recording().sweeps


def test_the_status_describes_the_scan(mapping, probe, files):
    _, hand = mapping()
    probe.until(lambda: len(hand.statuses) > 2, "the status while nothing happens")
    idle = hand.statuses[-1]
    assert (idle.scan_file, idle.scene, idle.sweep_active, idle.samples) == (
        str(files["scan_file"]),
        "sheet",
        False,
        0,
    )
    hand.service("start_sweep")
    hand.slide(1000)
    hand.send_strain(1001, status=(0, 2, 0))
    hand.send_pose(1010)
    probe.until(lambda: any(status.rate > 0 for status in hand.statuses), "the rate")
    probe.until(lambda: hand.statuses[-1].skipped == 1, "the skipped sample")
    status = hand.statuses[-1]
    assert (status.sweep_active, status.sweep, status.sweeps) == (True, 1, 1)
    assert 190 <= status.samples <= 200
    assert 0.0 < status.coverage < 0.3
    begun = next(message for message in hand.statuses if message.sweep_active)
    assert stamp_of(begun) == 0, "the sweep began before the first sample"


def test_late_strain_is_recorded_where_it_was_felt(mapping, probe, files):
    _, hand = mapping(strain_delay_s=0.1)
    hand.slide(200)
    hand.wait_for_stamp(100)
    hand.service("start_sweep")
    hand.slide(400)
    hand.service("end_sweep")
    scan, (sweep,) = load(files)
    assert len(sweep) >= 60
    felt_ms = (sweep.stamp_ns - START) / MS
    np.testing.assert_allclose(sweep.strain[:, 0] % 1000, felt_ms + 100, atol=1e-6)
    np.testing.assert_allclose(scan.states[:, 0], x_at(felt_ms), atol=1e-9)
    assert ScanFolder(files["scan_file"]).strain_delay_s == 0.1


@pytest.mark.parametrize(
    ("name", "wrong", "refusal"),
    [("frame", "map", "frame 'map'"), ("phalanges", ("middle", "thumb"), "phalanx 'index'")],
)
def test_invalid_messages_prevent_a_sweep(mapping, probe, name, wrong, refusal):
    process, hand = mapping()
    right = getattr(hand, name)
    setattr(hand, name, wrong)
    probe.until(lambda: hand.slide(20) or refusal in process.output, refusal)
    answer = hand.service("start_sweep")
    assert not answer.success
    assert refusal in answer.message
    setattr(hand, name, right)
    probe.until(lambda: hand.slide(20) or hand.service("start_sweep").success, "a sweep")


def test_the_map_is_latched_after_a_sweep(mapping, probe, files):
    _, hand = mapping()
    hand.service("start_sweep")
    hand.slide(300)
    hand.wait_for_stamp(300)
    hand.service("end_sweep")
    clouds = probe.listen(PointCloud2, "tactile_mapping/map", probe.latched)
    probe.until(lambda: clouds, "the map")
    assert clouds[-1].header.frame_id == "material"
    assert clouds[-1].width > 0


def test_at_the_end_of_a_session_the_scan_examines_itself(mapping, probe, files):
    process, hand = mapping()
    for _ in range(2):
        hand.service("start_sweep")
        hand.slide(1000)
        hand.service("end_sweep")
    assert probe.change("tactile_mapping", "deactivate")
    finding = "only 2 sweeps, which says little"
    probe.until(lambda: finding in process.output, "the examination", timeout_s=120.0)
    assert "parts of 2 sweeps, each on a map without it" in process.output
    assert {"calibration.json", "calibration.npz"} <= {each.name for each in files["scan_file"].iterdir()}
    assert probe.change("tactile_mapping", "activate"), "another session"
    assert process.stop() == 0


def test_diagnostics_describe_recording_and_losses(mapping, probe, files):
    process, hand = mapping()
    reports = probe.diagnostics()

    def latest():
        return reports[-1].status[0] if reports else None

    def poses():
        return next(int(value.value) for value in latest().values if value.key == "poses")

    probe.until(latest, "diagnostics")
    assert poses() == 0
    silence = "no strain on /strain (1 publisher); no palm_pose on /palm_pose (1 publisher)"
    probe.until(lambda: latest().message == f"no active sweep: {silence}", "an error of silence")
    assert (latest().name, latest().level) == ("tactile_mapping: scan", DiagnosticStatus.ERROR)
    process.wait_for_line("WARN.*no strain on /strain")
    probe.until(lambda: len(reports) > 2, "repeated reports")
    assert process.output.count("WARN") == 1
    probe.until(lambda: hand.slide(40) or latest().level != DiagnosticStatus.ERROR, "no error")
    hand.service("start_sweep")
    before = hand.now_ms // 20
    hand.slide(100)
    hand.slide(200, poses=False)
    hand.slide(100)
    probe.until(
        lambda: any("samples without a pose" in m.status[0].message for m in reports), "a warning of gaps"
    )
    hand.frame = "map"
    hand.slide(40)
    probe.until(lambda: "frame 'map'" in latest().message, "the frame")
    assert latest().level == DiagnosticStatus.ERROR
    assert poses() == before + 10, "only valid poses count"


def test_a_full_disk_is_survived(mapping, probe, files):
    process, hand = mapping()
    reports = probe.diagnostics()
    hand.service("start_sweep")
    hand.slide(100)
    hand.wait_for_stamp(100)
    limit = resource.prlimit(process.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (100, limit[1]))
    probe.until(lambda: hand.slide(50) or not hand.statuses[-1].sweep_active, "the end of the sweep")
    process.wait_for_line("could not be written")
    probe.until(lambda: any("could not be written" in each.status[0].message for each in reports), "an error")
    assert reports[-1].status[0].level == b"\x02"
    assert "could not be written" in hand.service("end_sweep").message
    assert not hand.service("start_sweep").success
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, limit)
    assert hand.service("start_sweep").success
    hand.slide(100)
    hand.wait_for_stamp(hand.now_ms)
    assert process.stop() == 0
    _, sweeps = load(files)
    assert sweeps[-1].ending == "ended"
    assert len(sweeps[-1]) > 0


def test_a_killed_recording_continues_with_a_new_sweep(mapping, probe, files):
    process, hand = mapping()
    hand.service("start_sweep")
    hand.slide(600)
    hand.wait_for_stamp(600)
    probe.until(lambda: hand.statuses[-1].samples >= 110, "pairs")
    reader = ScanFolder(files["scan_file"])
    probe.until(lambda: len(reader.recording()) >= 110, "committed pairs")
    process.stop(signal.SIGKILL)
    stored = len(load(files)[0])
    assert stored >= 110
    process, hand = mapping("again")
    probe.until(
        lambda: hand.statuses and hand.statuses[-1].samples == stored, "the status of the stored pairs"
    )
    assert "sweep 2" in hand.service("start_sweep").message
    hand.slide(200)
    probe.until(lambda: hand.statuses[-1].samples > stored, "further pairs")
    assert process.stop() == 0
    _, sweeps = load(files)
    assert [sweep.ending for sweep in sweeps] == ["ended early", "ended"]


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"scene_file": "none.yaml"}, "none.yaml: expected a scene file"),
        ({"scan_file": ""}, "scan_file: expected a path, got none"),
        ({"scan_file": "file_scan"}, "file_scan: expected a folder that can be written, Not a directory"),
        ({"scan_file": "other_scan"}, "other_scan: expected the name "),
    ],
)
def test_an_invalid_configuration_is_rejected_in_one_line(
    refusal, files, tmp_path, monkeypatch, parameters, message
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file_scan").write_text("not a scan " * 100)
    other = Scene("other", (Axis("x", 0.0, 1.0),), (Phalanx("index", (0.0,)),))
    ScanWriter(tmp_path / "other_scan", other).close()
    (line,) = refusal("mapping_node", files | parameters)
    assert message in line
