"""Adapter node: publishes strain vectors from the messages of other tactile sensors.

A YAML file maps message fields to strain; see ``docs/sensors.md``. Publishes ``strain`` and, at 1 Hz,
``/diagnostics`` with the rate of each sensor topic and the messages that could not be used.
"""

import importlib
from collections import Counter
from functools import partial
from itertools import filterfalse
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from tactile_localizer.errors import MeasurementError, ParameterError
from tactile_localizer.io.strain_adapter import StrainSource, load_adapter
from tactile_localizer.msg import StrainVectors
from tactile_localizer.resources import given_or_shipped
from tactile_localizer.ros.base.executable import run
from tactile_localizer.ros.base.managed_node import ManagedNode
from tactile_localizer.ros.base.parameters import Parameter
from tactile_localizer.ros.base.qos import STRAIN
from tactile_localizer.ros.conversions import fill
from tactile_localizer.ros.diagnostics.status import DiagnosticsPublisher, Increments, publisher_names
from tactile_localizer.streams.runs import NANOSECONDS

PARAMETERS = (
    Parameter(
        "adapter_file",
        "wrench.yaml",
        "Message fields that are strain (YAML): path or shipped file name",
        at_start=True,
    ),
    Parameter("frame_id", "palm", "Frame in the header of the strain vectors"),
)


_WARNING_PERIOD_S = 5.0
_FAR_S = 1.0
"""Difference between stamps and times of receipt from which they are of different clocks, s (judgement)."""


class AdapterNode(ManagedNode):
    """Subscribes to sensor messages and publishes their values on ``strain``."""

    def __init__(self) -> None:
        super().__init__("tactile_adapter", PARAMETERS)
        self._sequence = 0

    def configure(self) -> None:
        """Read the YAML file and create the publisher."""
        self._adapter = load_adapter(given_or_shipped(self.parameters["adapter_file"], "config/adapters"))
        self._types = {source.topic: message_type(source) for source in self._adapter.sources}
        self._message = StrainVectors(
            phalanges=list(self._adapter.phalanges), channels=self._adapter.layout.counts
        )
        self._message.header.frame_id = self.parameters["frame_id"]
        self._publisher = self.create_lifecycle_publisher(StrainVectors, "strain", STRAIN)
        self._health = DiagnosticsPublisher(self)

    def activate(self) -> None:
        """Subscribe to the sensor messages."""
        self._adapter.reset()
        self._received: Counter[str] = Counter()
        self._invalid: dict[str, str] = {}
        self._increments = Increments()
        self._health.publish_each_second(self._statuses)
        for topic, type_ in self._types.items():
            self.create_subscription(type_, topic, partial(self._on_message, topic), STRAIN)

    def _on_message(self, topic: str, message: Any) -> None:
        self._received[topic] += 1
        try:
            vector = self._adapter.feed(topic, message, self.now_ns)
        except MeasurementError as error:
            self._invalid[topic] = str(error)
            self.get_logger().warning(str(error), throttle_duration_sec=_WARNING_PERIOD_S)
            return
        if vector is None:
            return
        self._sequence += 1
        sequence = np.full(len(vector.status), self._sequence & 0xFFFFFFFF, np.uint32)
        fill(self._message, *vector, sequence)
        self._publisher.publish(self._message)

    def _statuses(self) -> list[DiagnosticStatus]:
        """Rate of each topic, and what was wrong with its messages since the previous status."""
        new = self._increments.since({topic: self._received[topic] for topic in self._types})
        errors = [f"no messages on {topic}" for topic, count in new.items() if not count]
        errors += filter(None, map(self._mixed, self._types))
        problems = [*errors, *self._invalid.values(), *self._adapter.findings()]
        level = DiagnosticStatus.WARN if problems else DiagnosticStatus.OK
        level = DiagnosticStatus.ERROR if errors else level
        elapsed_s = self._increments.elapsed_s
        values = {f"rate_hz_{topic}": f"{count / elapsed_s:.1f}" for topic, count in new.items()}
        values["strain_vectors"] = str(self._sequence)
        ahead_s = {topic: ahead_ns / NANOSECONDS for topic, ahead_ns in self._adapter.ahead_ns.items()}
        values |= {f"stamps_ahead_s_{topic}": f"{each:.3f}" for topic, each in ahead_s.items()}
        if far := [topic for topic, each in ahead_s.items() if abs(each) > _FAR_S]:
            advice = "stamp: receipt in the adapter takes the time of receipt"
            self.get_logger().warning(f"{', '.join(far)}: stamps of another clock; {advice}", once=True)
        self._invalid.clear()
        return [self._health.status("sensor", level, "; ".join(problems) or "OK", values)]

    def _mixed(self, topic: str) -> str:
        """More sources of a topic than the adapter can tell apart, in one line; empty if there are not."""
        publishers = self.get_publishers_info_by_topic(self.resolve_topic_name(topic))
        return self._adapter.mixed(topic, publisher_names(publishers))


def message_type(source: StrainSource) -> Any:
    """The class of the messages of a source.

    Raises
    ------
    ParameterError
        The type is not installed, or lacks the field.
    """
    package, _, name = source.kind.partition("/msg/")
    try:
        kind = getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError, TypeError):
        raise ParameterError(f"type {source.kind}: expected an installed message type, found none") from None
    for field in source.field.names:
        _require_field(kind, field, source.kind)
    return kind


def _require_field(kind: Any, path: str, name: str) -> None:
    """Require that the messages of a class, whose type has a ``name``, have a field."""
    inner: Any = kind
    try:
        for field in filterfalse(str.isdecimal, path.split(".")):
            if hasattr(inner, "point_step"):
                return  # each message says what fields the points of the cloud have
            slot: Any = dict(zip(inner.get_fields_and_field_types(), inner.SLOT_TYPES, strict=True))[field]
            slot = getattr(slot, "value_type", slot)  # of an array
            if hasattr(slot, "namespaces"):  # a message
                slot = getattr(importlib.import_module(".".join(slot.namespaces)), slot.name)
            inner = slot
    except (AttributeError, KeyError):
        raise ParameterError(f"field {path}: expected a field of {name}, found none") from None


def main() -> int:
    """Run the node; returns the exit status."""
    return run(AdapterNode)
