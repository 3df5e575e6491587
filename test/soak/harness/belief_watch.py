"""Compares converged posteriors with the true position of the simulated palm."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter, deque

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy

from harness.relay import Relay
from tactile_localizer.demo.watcher import Watcher
from tactile_localizer.msg import Posterior
from tactile_localizer.ros.conversions.timestamps import to_ns

_RELIABLE = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
_LONGEST_STEP_NS = 200_000_000
_KEPT = 100_000
_TRUTHS = 500

WRONG_M = 0.01
"""Error above which convergence is false, m: beyond the default convergence radius of 7.5 mm."""


class BeliefWatch:
    """Compares the posteriors of each sweep with the truth, in the thread of the watcher.

    Parameters
    ----------
    watcher : subscribes to the posteriors
    relay : shifts the stamps

    Attributes
    ----------
    misled : fault that excuses false convergence until the end of the sweep; empty if there is none
    judged, converged : posteriors compared with the truth, and those of them that have converged
    wrong : number of false convergences, by the fault that excuses them
    false_sweeps : first false convergence of each sweep that no fault excuses, one line each
    errors_m : errors of the converged posteriors, m
    """

    def __init__(self, watcher: Watcher, relay: Relay) -> None:
        self.judged = self.converged = 0
        self.wrong: Counter[str] = Counter()
        self.false_sweeps: list[str] = []
        self._is_false = False
        self.errors_m: deque[float] = deque(maxlen=_KEPT)
        self._relay = relay
        self._misled = self._excuse = ""
        self._from_ns: int | None = None
        self._waiting: deque[Posterior] = deque(maxlen=_KEPT)
        self._truths: deque[tuple[int, np.ndarray]] = deque(maxlen=_TRUTHS)
        watcher.listen(Posterior, "filter/posterior", _RELIABLE, self._on_posterior)
        watcher.listen(PoseStamped, "simulator/ground_truth", _RELIABLE, self._on_truth)

    @property
    def misled(self) -> str:
        """See the class."""
        return self._misled

    @misled.setter
    def misled(self, why: str) -> None:
        self._misled = why
        self._excuse = why or self._excuse  # the present sweep stays excused

    def begin_sweep(self, now_ns: int) -> None:
        """Compare posteriors stamped after ``now_ns``, when the belief is uniform."""
        self._excuse = self._misled
        self._from_ns = now_ns
        self._is_false = False

    def end_sweep(self) -> None:
        """Stop comparing: the fingers release the material, which the filter cannot detect."""
        self._from_ns = None

    def _on_posterior(self, message: Posterior) -> None:
        if not message.stale:
            self._waiting.append(message)

    def _on_truth(self, message: PoseStamped) -> None:
        stamp_ns, place = self._relay.shift(message), message.pose.position
        if self._truths and not 0 < stamp_ns - self._truths[-1][0] < _LONGEST_STEP_NS:
            self._truths.clear()
            self._waiting.clear()
        self._truths.append((stamp_ns, np.array([place.x, place.y])))
        while self._waiting and to_ns(self._waiting[0].header.stamp) <= stamp_ns:
            posterior = self._waiting.popleft()
            posterior_ns = to_ns(posterior.header.stamp)
            truth = self._truth_at(posterior_ns)
            if truth is not None and self._from_ns is not None and posterior_ns > self._from_ns:
                self._judge(posterior, truth)

    def _truth_at(self, stamp_ns: int) -> np.ndarray | None:
        """True position of the palm, (2,), m; ``None`` before the first."""
        after = bisect_left(self._truths, stamp_ns, key=lambda truth: truth[0])
        if after == 0:
            return None
        (before_ns, before), (after_ns, place) = self._truths[after - 1], self._truths[after]
        return before + (stamp_ns - before_ns) / (after_ns - before_ns) * (place - before)

    def _judge(self, posterior: Posterior, truth: np.ndarray) -> None:
        self.judged += 1
        if not posterior.converged:
            return
        self.converged += 1
        error = float(np.linalg.norm(np.array(posterior.mean) - truth))
        self.errors_m.append(error)
        if error > WRONG_M:
            self.wrong[self._excuse] += 1
            if not self._excuse and not self._is_false:
                self._is_false = True
                self.false_sweeps.append(
                    f"{1e3 * error:.1f} mm off after {1e3 * posterior.travel:.1f} mm of travel at "
                    f"x {1e3 * truth[0]:.1f}, y {1e3 * truth[1]:.1f} mm: {posterior.reason}"
                )
