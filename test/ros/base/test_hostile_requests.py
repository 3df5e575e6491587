"""Hostile requests, messages and files are rejected, and the node continues."""

import asyncio
import os

import pytest
from support.filter import CELL, Filter
from support.sweeps import SlidingHand, unseen_sweep, write_scan

pytestmark = pytest.mark.ros


def hostile_files(folder, scan):
    """Write what is no scan into ``folder``; returns the names."""
    (folder / "text_scan").write_bytes(b"x, y\n" * 1000)
    (folder / "folder_scan").mkdir()
    os.mkfifo(folder / "fifo_scan")
    (folder / "loop_scan").symlink_to("loop_scan")
    return ["text_scan", "folder_scan", "fifo_scan", "loop_scan"]


PATHS = (
    "", ".", "..", "/", "x" * 5000, "x/" * 2000, "\x00", "a\x00b_scan", "~", "-", "%s%n", "[/bold]", "\n",
    "ü" * 300,    "/dev/zero", "/proc/self/mem", "file:bump_scan?mode=memory", ":memory:",
)  # fmt: skip


def test_hostile_scans_leave_the_filter_and_its_map(node_process, probe, tmp_path):
    from tactile_localizer.srv import LoadScan

    scan, folder = tmp_path / "bump_scan", tmp_path / "maps"
    folder.mkdir()
    write_scan(scan)
    files = hostile_files(folder, scan)
    process = node_process("filter_node", {"scan_file": scan, "scan_directory": folder, **CELL})
    node = Filter(process, probe, SlidingHand(probe, unseen_sweep()))
    node.slide(20)
    for path in (*PATHS, *files):
        answer = probe.call(LoadScan, "filter/load_scan", LoadScan.Request(path=path))
        assert not answer.success, path
        assert answer.message, path
        assert "\n" not in answer.message, path
        assert "unexpected" not in answer.message, f"{path}: {answer.message}"
    node.slide(20)
    assert node.fresh()[-1].travel > 0.005, "the belief went on"
    assert process.stop() == 0


def test_invalid_parameter_values_are_rejected(node_process, probe, tmp_path):
    scan = tmp_path / "bump_scan"
    write_scan(scan)
    process = node_process("filter_node", {"scan_file": scan, **CELL})
    node = Filter(process, probe, SlidingHand(probe, unseen_sweep()))
    for name in (
        "convergence_radius",
        "update_distance",
        "particles_rate_hz",
        "shown_particles",
        "scan_file",
    ):
        for value in (
            float("nan"),
            float("inf"),
            -1.0,
            0.0,
            1e300,
            2**62,
            -(2**63),
            True,
            "x" * 10_000,
            [],
            [1.0],
        ):
            result = probe.set_parameter("filter", name, value)
            assert not result.successful, (name, value)
            assert result.reason
    node.slide(20)
    assert process.stop() == 0


def fail(*arguments):
    raise KeyError("a key\nthat is not there")


def test_an_unexpected_exception_is_a_rejection_in_one_line():
    import rclpy
    from rclpy.lifecycle import TransitionCallbackReturn
    from std_msgs.msg import Empty
    from std_srvs.srv import Trigger

    from tactile_localizer.ros.base.managed_node import ManagedNode

    rclpy.init()
    node = ManagedNode("fragile")
    try:
        service = node.create_service(Trigger, "~/break", fail)
        answer = asyncio.run(service.callback(Trigger.Request(), Trigger.Response(success=True)))
        assert not answer.success
        assert answer.message.startswith("unexpected KeyError: 'a key\\nthat is not there' (test_hostile")
        node.create_subscription(Empty, "~/broken", fail, 1).callback(Empty())
        node.create_timer(1.0, fail).callback()
        node.configure = fail
        assert node.trigger_configure() == TransitionCallbackReturn.FAILURE
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
