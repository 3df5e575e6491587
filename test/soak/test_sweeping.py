"""Continuous sweeps of the simulated hand."""

from types import SimpleNamespace

import pytest
from support.waiting import wait_until

pytestmark = pytest.mark.ros


class Mapping:
    """Substitute for a watcher: the mapping node starts a sweep after the request to end it."""

    def __init__(self):
        self.is_recording, self.begun, self.after_it = False, 0, []

    def listen(self, kind, topic, quality, work):
        if topic == "mapping/status":
            self._tell = work

    def call(self, kind, service, request=None, timeout_s=0.0):
        from tactile_localizer.errors import LiveError

        if service == "mapping/start_sweep":
            raise LiveError("no answer: it is stopped")
        if service == "mapping/end_sweep":
            self.is_recording = False
        if service == "simulator/prepare" and self.begun:
            self.after_it.append(self.is_recording)
        if service == "simulator/prepare" and not self.begun:
            self.begun, self.is_recording = True, True
            self._tell(SimpleNamespace(sweep_active=True, samples=1))
            raise LiveError("no answer")
        return SimpleNamespace(success=True)


def test_a_late_recording_ends_before_the_next_sweep():
    from harness import sweeping

    mapping, belief = Mapping(), SimpleNamespace(end_sweep=lambda: None, begin_sweep=lambda now_ns: None)
    with sweeping.Sweeping(mapping, SimpleNamespace(clock_ns=0), belief) as hand:
        hand._active.extend([True, False])
        wait_until(lambda: mapping.after_it, "the next sweep")
    assert mapping.after_it[0] is False
