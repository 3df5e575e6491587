"""Long computations in a thread."""

import threading

import pytest

from tactile_localizer.ros.base.background import run_in_thread


def failing():
    raise ValueError("late")


@pytest.mark.parametrize("end", [lambda: "result", failing], ids=["result", "error"])
def test_work_that_outlives_the_executor_is_discarded(probe, monkeypatch, end):
    unhandled, begun, released = [], threading.Event(), threading.Event()
    monkeypatch.setattr(threading, "excepthook", unhandled.append)

    def work():
        begun.set()
        released.wait(10.0)
        return end()

    before = set(threading.enumerate())
    probe.executor.create_task(run_in_thread, probe.node, work)
    probe.until(begun.is_set, "the work to begin")
    (thread,) = set(threading.enumerate()) - before
    probe.close()
    released.set()
    thread.join(10.0)
    assert not thread.is_alive()
    assert unhandled == []
