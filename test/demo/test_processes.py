"""Nodes as processes: failures are reported, and all processes are stopped."""

import os
import signal
import subprocess
import sys

import pytest
from support.waiting import wait_until

from tactile_localizer.demo.processes import NodeProcesses, node_executable
from tactile_localizer.errors import LiveError

STUBBORN = """
import signal, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print("[INFO] [1.0] [node]: ready", flush=True)
time.sleep(60)
"""
WILLING = """
import signal, sys, time
signal.signal(signal.SIGINT, lambda *_: sys.exit(0))
print("[INFO] [1.0] [node]: ready", flush=True)
time.sleep(60)
"""
FAILING = """
print("[ERROR] [1.0] [node]: can0: expected an interface, found none", flush=True)
raise SystemExit(2)
"""


@pytest.fixture
def executables(tmp_path, monkeypatch):
    """Three installed programs that behave as nodes do."""
    folder = tmp_path / "prefix" / "lib" / "tactile_localizer"
    folder.mkdir(parents=True)
    for name, text in (("stubborn", STUBBORN), ("willing", WILLING), ("failing", FAILING)):
        program = folder / name
        program.write_text(f"#!{sys.executable}\n{text}")
        program.chmod(0o755)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "prefix"))
    return folder


def is_alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_the_context_stops_all_processes(executables, tmp_path, monkeypatch):
    monkeypatch.setattr("tactile_localizer.demo.processes._STOP_TIMEOUT_S", 0.3)
    pids = []

    def interrupted():
        with NodeProcesses(tmp_path, {}) as nodes:
            for name in ("willing", "stubborn"):
                node = nodes.start(name, name, {"rate_hz": 1.0, "names": ["a", "b"]})
                pids.append(node.pid)
                wait_until(lambda node=node: node.last_line == "ready", "its line")
            nodes.check()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert not any(map(is_alive, pids))
    assert "rate_hz: 1.0" in (tmp_path / "willing.yaml").read_text()


def test_a_node_that_is_being_started_at_an_interrupt_is_stopped(executables, tmp_path, monkeypatch):
    pids = []

    class Interrupted(subprocess.Popen):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            pids.append(self.pid)
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr("tactile_localizer.demo.processes.subprocess.Popen", Interrupted)
    with pytest.raises(KeyboardInterrupt), NodeProcesses(tmp_path, {}) as nodes:
        nodes.start("willing", "willing", {})
    assert not any(map(is_alive, pids))


def test_an_ended_node_is_reported_with_its_last_line(executables, tmp_path):
    with NodeProcesses(tmp_path, {}) as nodes:
        node = nodes.start("driver", "failing", {})
        assert node.wait(10.0)
        with pytest.raises(
            LiveError, match="driver: expected it to run, it ended: can0: expected an interface"
        ):
            nodes.check()


def test_single_nodes_can_be_stopped(executables, tmp_path):
    with NodeProcesses(tmp_path, {}) as nodes:
        node = nodes.start("mapping", "willing", {})
        wait_until(lambda: node.last_line == "ready", "its line")
        nodes.stop(node)
        assert not node.running
        nodes.check()


def test_a_missing_executable_is_reported():
    with pytest.raises(LiveError, match="nothing_node: expected it below AMENT_PREFIX_PATH, found none"):
        node_executable("nothing_node")
