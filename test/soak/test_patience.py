"""Time limits exclude the time in which a process waits for a processor."""

import os
import subprocess
import sys
import time

import pytest
from harness import patience
from harness.patience import Patience, starved_s
from support.waiting import wait_until


def compute(seconds):
    until_s = time.monotonic() + seconds
    while time.monotonic() < until_s:
        pass


@pytest.fixture
def shared_core():
    """One core for this process and another that computes without end."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    other = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        yield
    finally:
        other.kill()
        other.wait()
        os.sched_setaffinity(0, before)


def test_waiting_for_a_processor_is_counted(shared_core):
    begun_s = starved_s(os.getpid())
    wait_until(lambda: compute(0.05) or starved_s(os.getpid()) > begun_s + 0.2, "a fifth of a second")
    other = subprocess.Popen(["sleep", "60"])
    try:
        time.sleep(0.2)
        asleep_s = starved_s(other.pid)
        time.sleep(0.5)
        assert starved_s(other.pid) - asleep_s < 0.1
    finally:
        other.kill()
        other.wait()


def test_an_ended_process_does_not_wait():
    ended = subprocess.Popen(["true"])
    ended.wait()
    assert starved_s(ended.pid) == 0.0


@pytest.mark.parametrize(
    ("now_s", "taken_s", "is_over"),
    [(3.9, 0.0, False), (4.1, 0.0, True), (5.9, 2.0, False), (6.1, 2.0, True), (12.1, 60.0, True)],
    ids=["in time", "too late", "held up", "held up and too late", "held up too long"],
)
def test_limits_extend_by_the_wait_up_to_three_times(monkeypatch, now_s, taken_s, is_over):
    monkeypatch.setattr(patience.time, "monotonic", lambda: 100.0)
    monkeypatch.setattr(patience, "starved_s", lambda pid: 50.0)
    wait = Patience(4.0, [1, 2])
    monkeypatch.setattr(patience.time, "monotonic", lambda: 100.0 + now_s)
    monkeypatch.setattr(patience, "starved_s", lambda pid: 50.0 + (pid == 2) * taken_s)
    assert (wait.is_late, wait.is_over) == (now_s > 4.0, is_over)
