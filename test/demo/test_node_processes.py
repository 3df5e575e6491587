"""Nodes as processes: failures are reported, and all processes are stopped."""

import signal
import sys

import pytest
from support.waiting import wait_until

from tactile_localizer.demo.nodes import Nodes, node_executable, own_domain
from tactile_localizer.errors import LiveError

STUBBORN = """
import signal, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print("[INFO] [1.0] [node]: ready", flush=True)
time.sleep(60)
"""
FAILING = """
print("[ERROR] [1.0] [node]: can0: expected an interface, found none", flush=True)
raise SystemExit(2)
"""


@pytest.fixture
def executables(tmp_path, monkeypatch):
    """Installed programs in place of two nodes: one that ignores signals, and one that fails."""
    folder = tmp_path / "prefix" / "lib" / "tactile_localizer"
    folder.mkdir(parents=True)
    for name, text in (("filter", STUBBORN), ("driver", FAILING)):
        program = folder / f"{name}_node"
        program.write_text(f"#!{sys.executable}\n{text}")
        program.chmod(0o755)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "prefix"))
    monkeypatch.setattr("tactile_localizer.demo.nodes._STOP_TIMEOUT_S", 0.2)


def test_the_context_stops_all_processes(executables, tmp_path):
    with Nodes(tmp_path, {}) as nodes:
        node = nodes.start("filter", {"seed": 7})
        wait_until(lambda: node.last_line == "ready", "its line")
        nodes.check()
    assert node.process.poll() == -signal.SIGKILL
    assert "seed: 7" in (tmp_path / "filter.yaml").read_text()


def test_an_ended_node_is_reported_with_its_last_line(executables, tmp_path):
    with Nodes(tmp_path, {}) as nodes:
        nodes.start("driver", {}).process.wait(10.0)
        with pytest.raises(LiveError, match="driver: expected it to run, it ended: can0: expected an"):
            nodes.check()
        with pytest.raises(LiveError, match="driver: expected exit status 0, got 2: can0: expected an"):
            nodes.stop("driver")


def test_a_missing_executable_is_reported():
    with pytest.raises(LiveError, match="nothing_node: expected it below AMENT_PREFIX_PATH, found none"):
        node_executable("nothing_node")


def test_concurrent_runs_have_domains_of_their_own():
    with own_domain() as first, own_domain() as second:
        assert first != second
        assert first.bus["bus_options"] != second.bus["bus_options"]
