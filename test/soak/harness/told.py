"""What running nodes tell of themselves: diagnostics, log lines, posteriors. A fault must show there."""

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
from tactile_localizer.nodes.stamps import to_ns

_RELIABLE = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
_ROSOUT = QoSProfile(depth=1000, durability=DurabilityPolicy.VOLATILE)


@dataclass(frozen=True)
class Status:
    """One status out of the diagnostics: when it came (s, monotonic), of what, how bad, and its values."""

    at_s: float
    name: str
    level: bytes
    message: str
    values: dict[str, str]

    @property
    def is_well(self) -> bool:
        """Whether nothing is wrong."""
        return self.level == DiagnosticStatus.OK


class Told:
    """Gathers what is told, in the watcher's thread; read by any other.

    Parameters
    ----------
    watcher : hears it

    Attributes
    ----------
    newest : the newest status of each name
    fresh : the newest posterior that is not stale; ``None`` before the first
    fresh_s : when it came, s, monotonic
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
        """From here on, :meth:`diagnosed`, :meth:`logged` and :meth:`gained` look."""
        self._since_s = time.monotonic()
        self._before = dict(self.newest)
        self._statuses: list[Status] = []
        self._lines: list[str] = []

    def diagnosed(self, name: str, *texts: str) -> bool:
        """Whether a status was bad and said one of ``texts``."""
        return any(
            status.name == name and not status.is_well and any(text in status.message for text in texts)
            for status in list(self._statuses)
        )

    def logged(self, text: str) -> bool:
        """Whether a log line says so."""
        return any(text in line for line in list(self._lines))

    def gained(self, name: str, key: str) -> int:
        """By how much a count of a status has grown."""
        before, now = self._before.get(name), self.newest.get(name)
        if now is None or not now.values.get(key):
            return 0
        return int(now.values[key]) - int(before.values.get(key) or 0 if before else 0)

    def silent_s(self, name: str) -> float:
        """How long nothing has been told of ``name``, s."""
        newest = self.newest.get(name)
        return time.monotonic() - max(self._since_s, newest.at_s if newest else 0.0)

    def unwell(self, names: Sequence[str], since_s: float) -> str:
        """What is not well, or has not told of itself since ``since_s``; empty when all is."""
        for name in names:
            status = self.newest.get(name)
            if status is None or status.at_s <= since_s:
                return f"{name} says nothing"
            if not status.is_well:
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
        """How far the newest fresh posterior's stamp is behind the time, by a clock shifted so far, s."""
        if self.fresh is None:
            return float("inf")
        return (time.time_ns() + clock_ns - to_ns(self.fresh.header.stamp)) * 1e-9
