"""The soak as its user runs it, for a short while, and what it would find."""

import json
import mmap
import os
import re
import signal
import sys
from pathlib import Path

import pytest
from harness.memory import Memory, resident_bytes
from harness.soak_result import SoakResult
from support.waiting import children

pytestmark = pytest.mark.ros

SOAK = [sys.executable, Path(__file__).with_name("run.py")]
QUICK = ["bus off", "poses stop", "frames lost", "strain not finite", "wrong seed", "driver down and up"]


def command_line(pid):
    return Path(f"/proc/{pid}/cmdline").read_bytes()


@pytest.mark.slow
def test_a_short_soak_reports_all_faults_and_recovers(process, tmp_path):
    soak = process([*SOAK, "--minutes", "0.4", "-o", tmp_path, "--only", *QUICK])
    status = soak.wait(timeout_s=300.0)
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["failures"] == [], soak.output
    assert status == 0
    assert {one["fault"] for one in report["injections"]} <= set(QUICK)
    assert len(report["injections"]) >= 3
    assert all(one["reported_s"] < 4.0 and one["recovered_s"] is not None for one in report["injections"])
    assert report["sweeps"] >= 1
    assert report["converged"] > 0
    assert set(report["memory"]) == {"simulator", "driver", "mapping", "filter"}
    assert "nothing failed" in (tmp_path / "report.txt").read_text()
    assert "Traceback" not in soak.output


def test_an_ended_process_fails_the_soak(process, tmp_path):
    soak = process([*SOAK, "-o", tmp_path, "--only", "belief reset"])
    soak.wait_for_line("injecting faults", timeout_s=120.0)
    (mapping,) = [pid for pid in children(soak.pid) if b"mapping_node" in command_line(pid)]
    os.kill(mapping, signal.SIGKILL)
    assert soak.wait(timeout_s=60.0) == 1
    assert "FAILED: mapping: expected it to run, it ended" in soak.output
    assert children(soak.pid) == []


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--only", "rain"], "--only: expected some of frames lost"),
        (["--minutes", "0"], "--minutes: expected more than 0"),
    ],
)
def test_a_command_line_error_is_one_line(process, arguments, reason):
    soak = process([*SOAK, *arguments])
    assert soak.wait() == 2
    assert reason in soak.output
    assert len(soak.lines) == 1


def test_the_faults_page_lists_all_faults_and_existing_tests():
    from harness.faults import FAULTS

    tests = Path(__file__).parents[1]
    page = (tests.parent / "docs" / "faults.md").read_text(encoding="utf-8")
    assert [fault.name for fault in FAULTS if f"`{fault.name}`" not in page] == []
    named = set(re.findall(r"`([\w/]+/test_\w+\.py)`", page))
    assert len(named) > 10
    assert [name for name in named if not (tests / name).exists()] == []


def test_memory_growth_after_the_warm_up_is_reported():
    noise = [0, 1, -1, 2, 0, -2, 1, 0, -1, 0] * 10
    growing = Memory(warm_up=50, samples=[50_000_000 + 100_000 * k for k in range(150)])
    steady = Memory(warm_up=50, samples=[k * 1_000_000 for k in range(50)] + [50_000_000 + n for n in noise])
    assert growing.growth_bytes == pytest.approx(8_000_000, rel=0.1)
    assert abs(steady.growth_bytes) < 10


@pytest.mark.parametrize(
    ("name", "pairs", "fails"), [("mapping", 0, 1), ("mapping", 3000, 0), ("filter", 3000, 1)]
)
def test_only_mapping_may_grow_with_its_scan(name, pairs, fails):
    grown = Memory(samples=[50_000_000] * 10 + [60_000_000] * 10)
    result = SoakResult(memory={name: grown}, is_warm=True, recorded_pairs=pairs, sweeps=1, converged=1)
    assert len(result.failures) == fails


@pytest.mark.parametrize(("false", "sweeps", "fails"), [(1, 14, 0), (3, 14, 1), (10, 800, 0), (20, 800, 1)])
def test_one_sweep_in_a_hundred_may_converge_falsely(false, sweeps, fails):
    result = SoakResult(false_sweeps=["12 mm off"] * false, sweeps=sweeps, converged=1)
    assert len(result.failures) == fails


def test_process_memory_is_measured():
    before = resident_bytes(os.getpid())
    with mmap.mmap(-1, 30_000_000) as block:  # new pages, whatever the process has freed before
        block.write(b"x" * len(block))
        assert 25_000_000 < resident_bytes(os.getpid()) - before < 70_000_000
