"""Nodes as processes: failures are reported, and all processes are stopped."""

import contextlib
import os
import sys

import pytest
from support.waiting import children, wait_until

from tactile_localizer.demo.nodes import Nodes, node_command, own_domain, use_profile
from tactile_localizer.errors import LiveError

STUBBORN = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print("[INFO] [1.0] [node]: started with", sys.argv, flush=True)
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
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nonexistent:{tmp_path / 'prefix'}")
    monkeypatch.setattr("tactile_localizer.demo.nodes._STOP_TIMEOUT_S", 0.2)


def test_all_processes_are_stopped(executables, tmp_path):
    before = children(os.getpid())
    with contextlib.closing(Nodes(tmp_path)) as nodes:
        nodes.start("filter", {"seed": 7, "model": "off"})
        log = tmp_path / "filter.log"
        wait_until(lambda: log.read_text().endswith("\n"), "its whole line")
        nodes.check()
        assert "config/simulator.yaml', '-p', 'seed:=7', '-p', 'model:=\"off\"']" in log.read_text()
    assert children(os.getpid()) == before


def test_an_ended_node_is_reported_with_its_last_line(executables, tmp_path):
    with contextlib.closing(Nodes(tmp_path)) as nodes:
        nodes.start("driver", {})
        with pytest.raises(LiveError, match="driver: expected it to run, it ended: can0: expected an inter"):
            wait_until(nodes.check, "its end")


def test_a_missing_executable_is_reported():
    with pytest.raises(LiveError, match="nothing_node: expected it below AMENT_PREFIX_PATH, found none"):
        node_command("nothing_node", {})


def test_concurrent_runs_have_domains_of_their_own(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", os.environ["ROS_DOMAIN_ID"])  # restored after the test
    with own_domain() as port:
        domain = os.environ["ROS_DOMAIN_ID"]
        with own_domain() as other:
            assert (port, domain) != (other, os.environ["ROS_DOMAIN_ID"])
            assert port - int(domain) == other - int(os.environ["ROS_DOMAIN_ID"])


@pytest.mark.parametrize(
    ("version", "used"),
    [
        ("8.4.3", "FASTRTPS_DEFAULT_PROFILES_FILE"),
        ("9.3.3", "FASTDDS_DEFAULT_PROFILES_FILE"),
        ("10.0.1", "FASTDDS_DEFAULT_PROFILES_FILE"),
    ],
    ids=["Jazzy", "Kilted", "later"],
)
def test_the_profile_is_named_by_the_variable_of_the_installed_version(monkeypatch, tmp_path, version, used):
    """Another one that was set before makes Fast DDS 3 warn, and is not left."""
    monkeypatch.setattr("os.environ", {"FASTRTPS_DEFAULT_PROFILES_FILE": "other", "HOME": "/root"})
    package = tmp_path / "share" / "rmw_fastrtps_shared_cpp" / "package.xml"
    package.parent.mkdir(parents=True)
    package.write_text(f"<package><version>{version}</version></package>")
    os.environ["AMENT_PREFIX_PATH"] = f"/nonexistent:{tmp_path}"
    use_profile(tmp_path / "profile.xml")
    assert {name: value for name, value in os.environ.items() if "PROFILES" in name} == {
        used: str(tmp_path / "profile.xml")
    }


def test_a_process_prints_nothing_of_the_middleware(process):
    """As Fast DDS does if the profile is invalid, or its variable deprecated."""
    node = process(node_command("filter_node", {"scan_file": "/nonexistent"}))
    assert node.wait() == 2
    assert ["[tactile_filter]" in line for line in node.lines] == [True]
