"""The installed filter node: strain and poses in, estimates out."""

import dataclasses
import os
import re
import signal
import threading

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from rclpy.duration import Duration
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from support.diagnostics import status_of
from support.filter import CELL, Filter
from support.hand import SlidingHand
from support.processes import node_command
from support.sweeps import unseen_sweep, write_scan

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.msg import StrainVectors
from tactile_localizer.ros.filter_parameters import CONFIGURATION
from tactile_localizer.sim import shipped_scene
from tactile_localizer.srv import LoadScan

HOSTILE_PATHS = (
    "", ".", "..", "/", "x" * 5000, "x/" * 2000, "\x00", "a\x00b_scan", "~", "-", "%s%n", "[/bold]", "\n",
    "ü" * 300, "/dev/zero", "/proc/self/mem", "../bump_scan",
    "folder_scan", "fifo_scan", "loop_scan",
)  # fmt: skip


@pytest.fixture
def start(node_process, probe, scan_file):
    """Start the filter on the scan of the bump."""

    def start(sweep=None, **parameters):
        node = node_process("filter_node", {"scan_file": scan_file, **CELL, **parameters})
        return Filter(node, probe, SlidingHand(probe, sweep or unseen_sweep()))

    return start


def test_scans_are_loaded_only_from_the_scan_directory(start, probe, scan_file, tmp_path):
    directory = tmp_path / "scans"
    directory.mkdir()
    other = shipped_scene("snap")
    write_scan(directory / "snap_scan", "snap", other, short=True)
    (directory / "link_scan").symlink_to(scan_file)
    (directory / "loop_scan").symlink_to("loop_scan")
    (directory / "folder_scan").mkdir()
    os.mkfifo(directory / "fifo_scan")
    node = start(scan_directory=directory)
    maps = probe.listen(PointCloud2, "tactile_filter/map", probe.latched)
    node.slide(50)
    probe.until(lambda: maps, "the map to display")
    for path, reason, result in (
        ("link_scan", "expected a path in", LoadScan.Response.NOT_ALLOWED),
        ("none_scan", "expected a scan folder, found none", LoadScan.Response.NOT_USABLE),
    ):
        answer = probe.call(LoadScan, "tactile_filter/load_scan", LoadScan.Request(path=path))
        assert (answer.success, answer.result) == (False, result)
        assert reason in answer.message
    for path in HOSTILE_PATHS:
        answer = probe.call(LoadScan, "tactile_filter/load_scan", LoadScan.Request(path=path))
        assert (answer.success, bool(answer.message), "\n" in answer.message) == (False, True, False), path
        assert "unexpected" not in answer.message, f"{path}: {answer.message}"
    node.slide(5)
    assert node.fresh()[-1].travel > 0.01, "the belief is kept"
    assert len(maps) == 1
    answer = probe.call(LoadScan, "tactile_filter/load_scan", LoadScan.Request(path="snap_scan"))
    assert (answer.success, answer.message.split(": ")[0]) == (True, str(directory / "snap_scan"))
    probe.until(lambda: len(maps) == 2, "the new map to display")
    node.slide(5)
    assert node.fresh()[-1].travel < 0.005, "the belief is reset"
    probe.until(
        lambda: node.status("belief")[2].get("scan_file") == str(directory / "snap_scan"), "the new map"
    )


def test_topics_without_messages_are_warned_of_once(node_process, probe, scan_file):
    probe.node.create_publisher(PoseStamped, "arm/pose", 10)
    reports = probe.diagnostics()
    node = node_process("filter_node", {"scan_file": scan_file}, {"palm_pose": "arm/pose"})
    missing = r"no strain on /strain \(0 publishers\) and no palm_pose on /arm/pose \({}\), no estimate for"
    node.wait_for_line("WARN.*stale: " + missing.format(". publishers?"))
    known = missing.format("1 publisher")
    probe.until(lambda: re.match(known, status_of(reports, "tactile_filter: inputs")[1]), "the publisher")
    count = len(reports)
    probe.until(lambda: len(reports) > count, "diagnostics")
    assert node.output.count("WARN") == 1
    levels = {status.name: status.level for status in reports[-1].status}
    assert levels == {"tactile_filter: belief": b"\x03", "tactile_filter: inputs": b"\x02"}, "no green lamp"
    hand = SlidingHand(probe, unseen_sweep(), topics=("strain", "arm/pose"))
    probe.known_to("tactile_filter")
    found = r"stale: no palm_pose on /arm/pose .2 publishers., no estimate"
    probe.until(lambda: hand.slide(1, poses=False) or re.search(found, node.output), "the other reason")


def test_publishers_that_do_not_match_are_described(node_process, probe, scan_file):
    reliable = {"qos_overrides./strain.subscription.reliability": "reliable"}
    node = node_process("filter_node", {"scan_file": scan_file, **CELL, **reliable})
    probe.node.create_publisher(String, "palm_pose", 10)
    probe.node.create_publisher(StrainVectors, "strain", probe.best_effort)
    strain = r"no strain on /strain \(1 publisher, best effort, expected reliable\)"
    node.wait_for_line(strain + r" and no palm_pose on /palm_pose \(1 publisher, of std_msgs/msg/String\)")


SLOW_MODEL = """
import os
import time
from tactile_localizer.paper import SumOfGaussians

class Slow(SumOfGaussians):
    information_length = 0.005

    def log_likelihood(self, *arguments):
        while os.path.exists("BUSY"):
            time.sleep(0.01)
        return super().log_likelihood(*arguments)
"""


@pytest.mark.parametrize("end", ["deactivate", "signal"])
def test_what_has_arrived_is_localized_before_the_end(process, probe, scan_file, tmp_path, monkeypatch, end):
    samples, busy = 300, tmp_path / "busy"
    (tmp_path / "slow.py").write_text(SLOW_MODEL.replace("BUSY", str(busy)))
    reliable = {
        f"qos_overrides./{topic}.subscription.reliability": "reliable" for topic in ("strain", "palm_pose")
    }
    parameters = {"scan_file": scan_file, **CELL, "queue_depth": 1000, "model": "slow:Slow", **reliable}
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    running = process(node_command("filter_node", parameters), {"PYTHONPATH": path})
    monkeypatch.setattr(probe, "best_effort", 1000)  # of the strain: reliable, as the poses are
    node = Filter(running, probe, SlidingHand(probe, unseen_sweep(rate=50.0)))
    node.hand._poses = probe.publisher(PoseStamped, "palm_pose", 1000)
    busy.touch()
    node.hand.slide(samples)
    for publisher in (node.hand._strains, node.hand._poses):
        assert publisher.wait_for_all_acked(Duration(seconds=60))
    if end == "signal":
        os.kill(running.pid, signal.SIGINT)
        busy.unlink()
        assert running.wait() == 0
    else:
        threading.Timer(0.2, busy.unlink).start()
        assert probe.change("tactile_filter", "deactivate")
        probe.until(lambda: len(node.fresh()) == samples, "all posteriors")
    running.wait_for_line(f"{samples} strain vectors received, {samples} posteriors, 0 without a pose, 0")


def test_diagnostics_describe_belief_and_inputs(start, probe):
    node = start()
    node.slide(100)
    probe.until(lambda: "update_p99_us" in node.status("belief")[2], "the diagnostics")
    probe.until(
        lambda: node.status("belief")[2]["travel_m"] == f"{node.fresh()[-1].travel:.4f}", "the newest"
    )
    _, message, values = node.status("belief")
    posterior = node.fresh()[-1]
    assert values["reason"] == posterior.reason
    # The strain has stopped by now, and a stale estimate is not converged.
    assert values["converged"] == str(posterior.converged and not message.startswith("stale"))
    assert values["state"] in ("SEARCHING", "CONVERGED")
    assert values["probability"] == f"{posterior.probability:.4f}"
    assert values["on_map"] == f"{posterior.on_map:.4f}"
    assert values["inconsistent"] == ""
    assert 0 < float(values["update_median_us"]) <= float(values["update_p99_us"])
    _, _, inputs = node.status("inputs")
    assert int(inputs["updated"]) + int(inputs["moved"]) == len(node.fresh())


def test_live_parameters_keep_the_belief(start, probe):
    node = start()
    node.slide(40)
    before = node.fresh()[-1]
    assert before.state == before.SEARCHING
    for name, value in (
        ("convergence_radius", 0.1),
        ("convergence_probability", 0.5),
        ("convergence_travel", 1.0),
        ("update_distance", 0.0001),
        ("stale_timeout_s", 2.0),
        ("particles_rate_hz", 1.0),
        ("shown_particles", 10),
    ):
        answer = probe.set_parameter("tactile_filter", name, value)
        assert answer.successful, answer.reason
    assert "out of range" in probe.set_parameter("tactile_filter", "update_distance", np.nan).reason
    node.slide(1)
    after = node.fresh()[-1]
    np.testing.assert_allclose(after.mean, before.mean, atol=5e-3)
    assert after.travel > before.travel
    node.slide(80)
    after = node.fresh()[-1]
    assert "of 1000.0 mm" in after.reason
    assert probe.set_parameter("tactile_filter", "convergence_travel", 0.0).successful
    node.slide(3)
    assert node.fresh()[-1].converged


def test_a_file_of_the_scan_that_is_not_used_is_a_warning_of_the_node(node_process, tmp_path):
    write_scan(tmp_path / "scan", short=True)
    (tmp_path / "scan" / "sweep_old.npy").touch()
    node = node_process("filter_node", {"scan_file": tmp_path / "scan", **CELL})
    node.wait_for_line(r"\[WARN\] .*\[tactile_filter\]: .*sweep_old.npy: .* it is not used")


def test_each_configuration_field_is_a_parameter():
    fields = {field.name: field.default for field in dataclasses.fields(Configuration)}
    assert {parameter.name: parameter.default for parameter in CONFIGURATION} == fields


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"scan_file": "none"}, "none: expected a scan"),
        ({"scan_file": ""}, "scan_file: expected a path, got none"),
        ({"scene_file": "none.yaml"}, "none.yaml: expected a scene file"),
        ({"random_particles": 10}, "random_particles: expected 0 with filter grid, got 10"),
        ({"particles": -1}, "parameter particles: Parameter particles out of range"),
        (
            {"use_sim_time": "maybe"},
            ": parameter use_sim_time: Trying to set parameter 'use_sim_time' to 'maybe'",
        ),
        ({"material_pose": [1.0, 2.0]}, "material_pose: expected x, y, z, roll, pitch, yaw"),
    ],
)
def test_an_invalid_configuration_is_rejected_in_one_line(refusal, scan_file, parameters, message):
    (line,) = refusal("filter_node", {"scan_file": scan_file, **CELL, **parameters})
    assert message in line
