"""Estimate of the present time on the clock that stamps the messages."""

import pytest

pytestmark = pytest.mark.ros

SECOND = 1_000_000_000
NOW = 1_700_000_000 * SECOND


class Clock:
    """A sender clock on a receiver clock that shows ``receiver_ns``."""

    def __init__(self):
        from tactile_localizer.ros.subscriptions.tactile_inputs import SenderClock

        self.receiver_ns = 0
        self.sender = SenderClock(lambda: self.receiver_ns)

    def receive(self, delay_s, count=100, epoch=0):
        """Receive a message every 10 ms up to ``NOW``, with a delay of ``delay_s``, one slightly less."""
        for k in range(count):
            self.receiver_ns = NOW - (count - 1 - k) * SECOND // 100
            late_ns = round(delay_s * SECOND) + (k != 3) * SECOND // 1000
            self.sender.update(self.receiver_ns - late_ns, epoch)

    def now_ns(self, receiver_ns):
        self.receiver_ns = receiver_ns
        return self.sender.now_ns


@pytest.fixture
def clock():
    return Clock()


def test_small_delays_mean_the_same_clock(clock):
    clock.receive(0.3)
    assert clock.now_ns(NOW + 3 * SECOND) == NOW + 3 * SECOND


def test_a_clock_offset_is_learned_from_the_fastest_messages(clock):
    clock.receive(10.0)
    assert clock.now_ns(NOW + 3 * SECOND) == NOW - 7 * SECOND
    clock.receive(-10.0)
    assert clock.now_ns(NOW + 3 * SECOND) == NOW + 13 * SECOND


def test_a_backward_jump_resets_the_offset(clock):
    clock.receive(0.0)
    clock.receive(10.0, epoch=1)
    assert clock.now_ns(NOW + SECOND) == NOW - 9 * SECOND


def test_the_time_of_a_recording_stands_still_between_two_messages(clock):
    clock.receive(3600.0)
    assert clock.now_ns(NOW + SECOND) == NOW - 3600 * SECOND - SECOND // 1000


def test_the_time_is_never_before_the_newest_stamp(clock):
    clock.receive(-0.5)
    assert clock.now_ns(NOW) == NOW + SECOND // 2 - SECOND // 1000


def test_without_a_clock_the_time_is_the_newest_stamp(clock):
    assert clock.now_ns(0) == 0
    clock.sender.update(NOW, 0)
    assert clock.now_ns(0) == NOW
