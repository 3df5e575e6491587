"""Reports of running nodes: diagnostics, log lines, posteriors. Every fault must appear there."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Log
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from tactile_localizer.demo.watcher import Watcher
from tactile_localizer.msg import Posterior
from tactile_localizer.ros.conversions.timestamps import to_ns

_RELIABLE = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
_ROSOUT = QoSProfile(depth=1000, durability=DurabilityPolicy.VOLATILE)


@dataclass(frozen=True)
class Status:
    """One diagnostic status: time of receipt (s, monotonic), name, level, message and values."""

    at_s: float
    name: str
    level: bytes
    message: str
    values: dict[str, str]

    @property
    def is_ok(self) -> bool:
        """Whether the level is OK."""
        return self.level == DiagnosticStatus.OK


class Reports:
    """Collects reports in the watcher's thread; may be read from any other.

    Parameters
    ----------
    watcher : subscribes to the topics

    Attributes
    ----------
    newest : newest status by name
    fresh : newest posterior that is not stale; ``None`` before the first
    fresh_s : time of its receipt, s, monotonic
    """

    def __init__(self, watcher: Watcher) -> None:
        self.newest: dict[str, Status] = {}
        self.fresh: Any = None
        self.fresh_s = 0.0
        self._before: dict[str, Status] = {}
        self.forget()
        watcher.listen(DiagnosticArray, "/diagnostics", _RELIABLE, self._on_diagnostics)
        watcher.listen(Log, "/rosout", _ROSOUT, lambda message: self._lines.append(message.msg))
        watcher.listen(Posterior, "filter/posterior", _RELIABLE, self._on_posterior)

    def forget(self) -> None:
        """Restart :meth:`diagnosed`, :meth:`logged` and :meth:`gained` from now."""
        self._since_s = time.monotonic()
        self._before = dict(self.newest)
        self._statuses: list[Status] = []
        self._lines: list[str] = []

    def diagnosed(self, name: str, *texts: str) -> bool:
        """Whether a status was not OK and its message contained one of ``texts``."""
        return any(
            status.name == name and not status.is_ok and any(text in status.message for text in texts)
            for status in list(self._statuses)
        )

    def logged(self, text: str) -> bool:
        """Whether a log line contained ``text``."""
        return any(text in line for line in list(self._lines))

    def gained(self, name: str, key: str) -> int:
        """Increase of a counter in a status."""
        before, now = self._before.get(name), self.newest.get(name)
        if now is None or not now.values.get(key):
            return 0
        return int(now.values[key]) - int(before.values.get(key) or 0 if before else 0)

    def silent_s(self, name: str) -> float:
        """Time since the last status of ``name``, s."""
        newest = self.newest.get(name)
        return time.monotonic() - max(self._since_s, newest.at_s if newest else 0.0)

    def first_not_ok(self, names: Sequence[str], since_s: float) -> str:
        """First of ``names`` that is not OK, or has no status since ``since_s``; empty if there is none."""
        for name in names:
            status = self.newest.get(name)
            if status is None or status.at_s <= since_s:
                return f"{name} is silent"
            if not status.is_ok:
                return f"{name}: {status.message}"
        return "" if self.fresh_s > since_s else "no fresh posterior"

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        now_s = time.monotonic()
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            one = Status(now_s, status.name, status.level, status.message, values)
            self.newest[one.name] = one
            self._statuses.append(one)

    def _on_posterior(self, message: Posterior) -> None:
        if not message.stale:
            self.fresh, self.fresh_s = message, time.monotonic()

    def lag_s(self, clock_ns: int) -> float:
        """Delay of the newest fresh posterior's stamp behind a clock shifted by ``clock_ns``, s."""
        if self.fresh is None:
            return float("inf")
        return (time.time_ns() + clock_ns - to_ns(self.fresh.header.stamp)) * 1e-9
