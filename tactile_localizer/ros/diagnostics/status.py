"""Construction and publication of diagnostics."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from tactile_localizer.errors import counted
from tactile_localizer.ros.base.managed_node import ManagedNode

_PERIOD_S = 1.0
_CLOCK_STARTS_S = 10.0
"""Time without ``/clock`` that is logged, s: a replay starts it once the filter is active (judgement)."""


class DiagnosticsPublisher:
    """Publishes diagnostics of a node on ``/diagnostics``, whatever its lifecycle state.

    Parameters
    ----------
    node : node that the diagnostics belong to
    hardware_id : identifier of the device; empty if there is none
    """

    def __init__(self, node: ManagedNode, hardware_id: str = "") -> None:
        self._node, self._hardware_id = node, hardware_id
        self._name = node.get_fully_qualified_name().lstrip("/")
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._had_time_s = time.monotonic()

    def status(self, name: str, level: bytes, message: str, values: Mapping[str, Any]) -> DiagnosticStatus:
        """A status of this node; ``values`` are converted to text, and their names get underscores."""
        return DiagnosticStatus(
            name=f"{self._name}: {name}",
            hardware_id=self._hardware_id,
            level=level,
            message=message,
            values=[KeyValue(key=key.replace(" ", "_"), value=str(value)) for key, value in values.items()],
        )

    def publish_each_second(self, statuses: Callable[[], Sequence[DiagnosticStatus]]) -> None:
        """Publish what ``statuses`` returns at 1 Hz, until the transition in progress is undone."""
        self._node.create_timer(_PERIOD_S, lambda: self.publish(*statuses()))

    def publish(self, *statuses: DiagnosticStatus) -> None:
        """Publish statuses with the present time; none is OK while simulated time has no source."""
        now_s = time.monotonic()
        if problem := self._time_problem():
            for status in statuses:
                status.level = max(status.level, DiagnosticStatus.WARN)
                status.message = f"{problem}; {status.message}"
            if now_s - self._had_time_s > _CLOCK_STARTS_S:
                self._node.get_logger().warning(problem, once=True)
        else:
            self._had_time_s = now_s
        message = DiagnosticArray(status=statuses)
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)

    def _time_problem(self) -> str:
        if not self._node.get_parameter("use_sim_time").value:
            return ""
        topic = self._node.resolve_topic_name("/clock")
        publishers = self._node.count_publishers(topic)
        if publishers and self._node.now_ns:
            return ""
        return f"use_sim_time: no time on {topic} ({counted(publishers, 'publisher')})"


def publisher_names(publishers: Sequence[Any]) -> list[str]:
    """The full names of the nodes of publishers that the graph knows."""
    return sorted(f"{each.node_namespace.rstrip('/')}/{each.node_name}" for each in publishers)


class Increments:
    """Counts since the previous call; the first call counts from zero.

    Attributes
    ----------
    elapsed_s : time from the call before the last one to the last, s
    """

    def __init__(self) -> None:
        self._previous: Mapping[Any, int] = {}
        self._previous_s = time.monotonic()

    def since(self, counts: Mapping[Any, int]) -> dict[Any, int]:
        """Increases of totals, by the same keys."""
        new = {what: count - self._previous.get(what, 0) for what, count in counts.items()}
        now_s = time.monotonic()
        self.elapsed_s = max(now_s - self._previous_s, 1e-3)
        self._previous, self._previous_s = dict(counts), now_s
        return new

    def describe(self, counts: Mapping[str, int]) -> list[str]:
        """Each count that has increased, as ``"3 late messages"``, from totals by description."""
        return [f"{count} {what}" for what, count in self.since(counts).items() if count > 0]


class LargestRecent:
    """Largest value of a recent time.

    Parameters
    ----------
    period_s : values are forgotten after one to two of this, s
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._present = self._previous = -math.inf
        self._since_s = time.monotonic()

    def add(self, value: float) -> None:
        """Add a value of now."""
        self._forget()
        self._present = max(self._present, value)

    @property
    def largest(self) -> float:
        """The largest value; minus infinity without any."""
        self._forget()
        return max(self._previous, self._present)

    def _forget(self) -> None:
        elapsed_s = time.monotonic() - self._since_s
        if elapsed_s > self._period_s:
            self._previous = self._present if elapsed_s < 2 * self._period_s else -math.inf
            self._present = -math.inf
            self._since_s += elapsed_s
