"""Adapter node: publishes strain vectors from the messages of other tactile sensors.

A YAML file maps message fields to strain; see ``docs/sensors.md``.
"""

from __future__ import annotations

import importlib
from array import array
from functools import partial
from typing import Any

from tactile_localizer.errors import MeasurementError, ParameterError
from tactile_localizer.io.strain_adapter import load_adapter
from tactile_localizer.msg import StrainVectors
from tactile_localizer.resources import given_or_shipped
from tactile_localizer.ros.base.executable import run
from tactile_localizer.ros.base.managed_node import ManagedNode
from tactile_localizer.ros.base.qos import STRAIN
from tactile_localizer.ros.conversions.timestamps import from_ns
from tactile_localizer.ros.parameters.adapter import PARAMETERS

_WARNING_PERIOD_S = 5.0


class AdapterNode(ManagedNode):
    """Subscribes to sensor messages and publishes their values on ``strain``."""

    def __init__(self) -> None:
        super().__init__("adapter", PARAMETERS)
        self._sequence = 0

    def configure(self) -> None:
        """Read the YAML file and create the publisher."""
        self._adapter = load_adapter(given_or_shipped(self.parameters["adapter_file"], "config/adapters"))
        self._types = {topic: message_type(name) for topic, name in self._adapter.topics.items()}
        self._message = StrainVectors(
            phalanges=list(self._adapter.phalanges), channels=self._adapter.layout.counts
        )
        self._message.header.frame_id = self.parameters["frame_id"]
        self._publisher = self.create_lifecycle_publisher(StrainVectors, "strain", STRAIN)

    def activate(self) -> None:
        """Subscribe to the sensor messages."""
        self._adapter.reset()
        for topic, type_ in self._types.items():
            self.create_subscription(type_, topic, partial(self._on_message, topic), STRAIN)

    def _on_message(self, topic: str, message: Any) -> None:
        try:
            vector = self._adapter.feed(topic, message, self.now_ns)
        except MeasurementError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=_WARNING_PERIOD_S)
            return
        if vector is None:
            return
        self._sequence += 1
        outgoing = self._message
        outgoing.header.stamp = from_ns(vector.stamp_ns)
        outgoing.strain = array("d", vector.strain.tobytes())
        outgoing.status = array("B", vector.status.tobytes())
        outgoing.sequence = [self._sequence & 0xFFFFFFFF] * len(vector.status)
        self._publisher.publish(outgoing)


def message_type(name: str) -> Any:
    """The class of a message type such as ``geometry_msgs/msg/WrenchStamped``.

    Raises
    ------
    ParameterError
        The type is not installed.
    """
    package, _, message = name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), message)
    except (ImportError, AttributeError):
        raise ParameterError(f"type {name}: expected an installed message type, found none") from None


def main() -> int:
    """Run the node; returns the exit status."""
    return run(AdapterNode)
