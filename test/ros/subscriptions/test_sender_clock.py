"""Estimate of the present time on the clock that stamps the messages."""

import pytest

pytestmark = pytest.mark.ros

SECOND = 1_000_000_000
NOW = 1_700_000_000 * SECOND


@pytest.fixture
def clock():
    from tactile_localizer.ros.subscriptions.sender_clock import SenderClock

    return SenderClock()


def receive(clock, delay_s, count=100, epoch=0):
    """Send a message each 10 ms up to ``NOW``, with a delay of ``delay_s``, one slightly less."""
    for k in range(count):
        now_ns = NOW - (count - 1 - k) * SECOND // 100
        clock.update(now_ns - round(delay_s * SECOND) - (k != 3) * SECOND // 1000, now_ns, epoch)


def test_small_delays_mean_the_same_clock(clock):
    receive(clock, 0.3)
    assert clock.now_ns(NOW + 3 * SECOND) == NOW + 3 * SECOND


def test_a_clock_offset_is_learned_from_the_fastest_messages(clock):
    receive(clock, 10.0)
    assert clock.now_ns(NOW + 3 * SECOND) == NOW - 7 * SECOND
    receive(clock, -10.0)
    assert clock.now_ns(NOW + 3 * SECOND) == NOW + 13 * SECOND


def test_a_backward_jump_resets_the_offset(clock):
    receive(clock, 0.0)
    receive(clock, 10.0, epoch=1)
    assert clock.now_ns(NOW + SECOND) == NOW - 9 * SECOND


def test_the_time_of_a_recording_stands_still_between_two_messages(clock):
    receive(clock, 3600.0)
    assert clock.now_ns(NOW + SECOND) == NOW - 3600 * SECOND - SECOND // 1000


def test_the_time_is_never_before_the_newest_stamp(clock):
    receive(clock, -0.5)
    assert clock.now_ns(NOW) == NOW + SECOND // 2 - SECOND // 1000


def test_without_a_clock_the_time_is_the_newest_stamp(clock):
    assert clock.now_ns(0) == 0
    clock.update(NOW, 0, 0)
    assert clock.now_ns(0) == NOW
