"""The filter in simulated time: clocks that stop, run and jump, looping bags, late subscribers."""

import re

import pytest
from rosgraph_msgs.msg import Clock as ClockMessage
from support.bags import START
from support.hand import SlidingHand, stamp_of
from support.sweeps import unseen_sweep

from tactile_localizer.msg import Posterior


class Clock:
    """``/clock``, controlled by the test."""

    def __init__(self, probe):
        self._probe = probe
        self._publisher = probe.publisher(ClockMessage, "/clock")
        probe.known_to("tactile_filter")
        self.now_ns = START

    def show(self):
        message = ClockMessage()
        message.clock.sec, message.clock.nanosec = divmod(self.now_ns, 1_000_000_000)
        self._publisher.publish(message)

    def show_until_seen(self):
        """Publish and wait until the filter received it: clock and strain arrive in any order."""
        seen = self._probe.diagnostics()
        self.show()
        self._probe.until(lambda: seen and stamp_of(seen[-1]) == self.now_ns, "diagnostics at this time")

    def run(self, seconds):
        """Advance time in steps of 50 ms, faster than real time."""
        for _ in range(round(seconds / 0.05)):
            self.now_ns += 50_000_000
            self.show()
            self._probe.executor.spin_once(timeout_sec=0.01)


@pytest.fixture
def filter_in_simulated_time(node_process, probe, scan_file):
    process = node_process("filter_node", {"scan_file": scan_file, "cell": 1.0, "use_sim_time": True})
    posteriors = probe.listen(Posterior, "tactile_filter/posterior", 1000)
    hand = SlidingHand(probe, unseen_sweep())
    diagnostics = probe.diagnostics()
    probe.until(lambda: diagnostics, "diagnostics: all are matched by now")
    return process, posteriors, hand


def slide(probe, hand, posteriors, samples):
    hand.slide(samples)
    last_ns = hand.offset_ns + hand.strain_ns[hand.next - 1]
    probe.until(
        lambda: any(not message.stale and stamp_of(message) == last_ns for message in posteriors),
        "the posterior",
    )


def test_without_a_clock_stamps_determine_the_time(filter_in_simulated_time, probe):
    _, posteriors, hand = filter_in_simulated_time
    slide(probe, hand, posteriors, 40)
    fresh = [message for message in posteriors if not message.stale]
    assert [hand.sample_of(message) for message in fresh] == list(range(40))


def test_simulated_time_without_a_clock_is_reported(filter_in_simulated_time, probe):
    from diagnostic_msgs.msg import DiagnosticStatus

    process, _, _ = filter_in_simulated_time
    reports, problem = probe.diagnostics(), "use_sim_time: no time on /clock ({})"
    probe.until(lambda: reports, "diagnostics")
    for status in reports[-1].status:
        assert status.level == DiagnosticStatus.WARN
        assert status.message.startswith(problem.format("0 publishers"))
    process.wait_for_line(r"\[WARN\].*" + re.escape(problem.format("0 publishers")))
    clock = Clock(probe)
    probe.until(lambda: problem.format("1 publisher") in reports[-1].status[0].message, "its publisher")
    clock.show_until_seen()
    probe.until(
        lambda: not any("use_sim_time" in status.message for status in reports[-1].status),
        "diagnostics without the warning",
    )


def test_estimates_age_only_while_the_clock_runs(filter_in_simulated_time, probe):
    process, posteriors, hand = filter_in_simulated_time
    slide(probe, hand, posteriors, 20)
    reports = probe.diagnostics()
    probe.until(lambda: len(reports) >= 2, "diagnostics before the clock, which is later than the strain")
    still = len(posteriors)
    clock = Clock(probe)
    clock.show_until_seen()
    wall = []
    probe.node.create_timer(1.5, lambda: wall.append(True))
    probe.until(lambda: wall, "a period longer than the timeout")
    assert len(posteriors) == still, "estimates of a paused bag do not age"
    clock.run(1.0)
    probe.until(lambda: posteriors[-1].stale, "a stale estimate")
    clock.show()
    hand.offset_ns = clock.now_ns - int(hand.strain_ns[20])
    slide(probe, hand, posteriors, 20)
    reports.clear()
    probe.until(lambda: len(reports) >= 2, "diagnostics while the clock stands still")
    assert not posteriors[-1].stale, "a fresh estimate is not repeated as stale"
    clock.run(0.2)
    probe.until(lambda: "no longer stale" in process.output, "the log line")
    assert not posteriors[-1].stale


def test_a_looping_bag_resets_the_belief_with_its_clock(filter_in_simulated_time, probe):
    process, posteriors, hand = filter_in_simulated_time
    clock = Clock(probe)
    clock.show()
    slide(probe, hand, posteriors, 90)
    clock.run(3.0)
    first = [list(message.mean) for message in posteriors if not message.stale]
    clock.now_ns = START
    clock.show_until_seen()
    posteriors.clear()
    hand.next = 0
    slide(probe, hand, posteriors, 60)
    clock.run(0.3)
    again = [list(message.mean) for message in posteriors if not message.stale]
    assert again == first[:60]
    assert not posteriors[-1].stale
    assert process.stop() == 0
    assert "Traceback" not in process.output
