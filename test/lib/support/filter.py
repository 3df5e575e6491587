"""A running filter node, seen from outside."""

import time

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from std_srvs.srv import Empty
from support.diagnostics import status_of
from support.hand import stamp_of

from tactile_localizer.msg import Posterior

CELL = {"cell": 1.0}
"""Coarse grid resolution, for speed."""

_QUEUE = 100
_PAUSE_NS = 1_000_000_000_000


class Filter:
    """A running filter node, the messages that it publishes, and the hand that sends its inputs."""

    def __init__(self, process, probe, hand):
        self.process, self.probe, self.hand = process, probe, hand
        self.posteriors = []
        self.diagnostics = []
        self._restarted_ns = 0
        probe.node.create_subscription(Posterior, "tactile_filter/posterior", self._on_posterior, 1000)
        probe.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        probe.until(
            lambda: probe.node.count_publishers("tactile_filter/posterior"), "the publisher of the filter"
        )
        probe.known_to("tactile_filter")

    def _on_posterior(self, message):
        if stamp_of(message) >= self.hand.offset_ns:  # otherwise published before the restart
            self.posteriors.append(message)

    def _on_diagnostics(self, message):
        if stamp_of(message) >= self._restarted_ns:
            self.diagnostics.append(message)

    def restart(self):
        """Reset the belief and move the hand to the start of its sweep, at a later time."""
        self.hand.next = 0
        self.hand.offset_ns += _PAUSE_NS
        self.probe.call(Empty, "tactile_filter/reinitialize_global_localization")
        self._restarted_ns = time.time_ns()
        self.posteriors.clear()
        self.diagnostics.clear()

    def fresh(self):
        return [message for message in self.posteriors if not message.stale]

    def wait_for_sample(self, k):
        """Wait for the posterior of strain vector ``k``."""
        self.probe.until(
            lambda: (
                (fresh := self.fresh())
                and stamp_of(fresh[-1]) >= self.hand.offset_ns + self.hand.strain_ns[k]
            ),
            f"the posterior of strain {k}",
        )

    def slide(self, samples, **how):
        """Send the next samples and wait for the last posterior, without filling a queue."""
        while samples > 0:
            self.hand.slide(min(samples, _QUEUE // 2), **how)
            self.wait_for_sample(self.hand.next - 1)
            samples -= _QUEUE // 2

    def means(self):
        return np.array([message.mean for message in self.fresh()])

    def status(self, name):
        """Level, message and values of the newest diagnostic status ``name``."""
        return status_of(self.diagnostics, f"tactile_filter: {name}")

    def count(self, name):
        """Counter ``name`` of the inputs in diagnostics of the present."""
        now_ns = time.time_ns()
        self.probe.until(lambda: self.diagnostics and stamp_of(self.diagnostics[-1]) >= now_ns, "diagnostics")
        return int(self.status("inputs")[2].get(name, 0))

    def wait_for_count(self, name, expected):
        """Wait until counter ``name`` of the inputs is ``expected``."""
        self.probe.until(
            lambda: self.status("inputs")[2].get(name) == str(expected), f"{name} to be {expected}"
        )


def initial_pose(x, y, variance, frame="material"):
    message = PoseWithCovarianceStamped()
    message.header.frame_id = frame
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    message.pose.pose.orientation.w = 1.0
    message.pose.covariance[0] = message.pose.covariance[7] = variance
    return message
