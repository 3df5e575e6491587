"""The hand that sweeps on, whatever becomes of the nodes."""

from types import SimpleNamespace

import pytest
from support.waiting import wait_until

pytestmark = pytest.mark.ros


class Mapping:
    """In place of a watcher: a mapping that begins a sweep only after it was asked to end it."""

    def __init__(self):
        self.is_recording, self._begins = False, False
        self.recording_at_prepare = []

    def listen(self, *args):
        """Nothing is heard."""

    def call(self, kind, service, request=None, timeout_s=0.0):
        from tactile_localizer.errors import LiveError

        if service == "simulator/prepare":
            self.recording_at_prepare.append(self.is_recording)
        if service == "mapping/start_sweep":
            self._begins = True
            raise LiveError("no answer: it is stopped")
        if service == "mapping/end_sweep":
            self.is_recording, self._begins = self._begins, False
        return SimpleNamespace(success=True)


def test_a_recording_that_begins_late_is_ended_before_the_next_sweep(monkeypatch):
    from tactile_localizer.live import sweeping

    monkeypatch.setattr(sweeping, "RECORDED_EVERY", 1)
    mapping, belief = Mapping(), SimpleNamespace(end_sweep=lambda: None)
    with sweeping.Sweeping(mapping, None, belief):
        wait_until(lambda: len(mapping.recording_at_prepare) > 2, "the third sweep")
    assert not any(mapping.recording_at_prepare)
