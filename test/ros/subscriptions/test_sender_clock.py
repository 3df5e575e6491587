"""What is felt now, by the clock of whoever stamps it."""

import pytest

pytestmark = pytest.mark.ros

SECOND = 1_000_000_000
NOW = 1_700_000_000 * SECOND


@pytest.fixture
def clock():
    from tactile_localizer.ros.subscriptions.sender_clock import SenderClock

    return SenderClock()


def hear(clock, behind_s, count=100, epoch=0):
    """A message each 10 ms up to ``NOW``, each ``behind_s`` behind the node's clock, one a little less."""
    for k in range(count):
        now_ns = NOW - (count - 1 - k) * SECOND // 100
        clock.update(now_ns - round(behind_s * SECOND) - (k != 3) * SECOND // 1000, now_ns, epoch)


def test_stamps_of_the_nodes_own_clock_however_late_they_come(clock):
    hear(clock, 0.3)
    assert clock.now_ns(NOW + 3 * SECOND) == NOW + 3 * SECOND


def test_a_clock_that_is_off_is_learned_from_the_messages_that_came_soonest(clock):
    hear(clock, 10.0)
    assert clock.now_ns(NOW + 3 * SECOND) == NOW - 7 * SECOND
    hear(clock, -10.0)
    assert clock.now_ns(NOW + 3 * SECOND) == NOW + 13 * SECOND


def test_what_was_learned_is_forgotten_when_stamps_were_set_back(clock):
    hear(clock, 0.0)
    hear(clock, 10.0, epoch=1)
    assert clock.now_ns(NOW + SECOND) == NOW - 9 * SECOND


def test_the_time_of_a_recording_stands_still_between_two_messages(clock):
    hear(clock, 3600.0)
    assert clock.now_ns(NOW + SECOND) == NOW - 3600 * SECOND - SECOND // 1000


def test_it_is_never_before_the_newest_stamp(clock):
    hear(clock, -0.5)
    assert clock.now_ns(NOW) == NOW + SECOND // 2 - SECOND // 1000


def test_before_the_nodes_clock_runs_the_newest_stamp_is_all_that_is_known(clock):
    assert clock.now_ns(0) == 0
    clock.update(NOW, 0, 0)
    assert clock.now_ns(0) == NOW
