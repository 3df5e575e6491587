"""Strain vectors from the messages of any tactile sensor's driver, as a YAML file says."""

from __future__ import annotations

import importlib
from array import array
from functools import partial
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy

from tactile_localizer.errors import MeasurementError, ParameterError
from tactile_localizer.io.strain_adapter import StrainAdapter, load_adapter
from tactile_localizer.msg import StrainVectors
from tactile_localizer.resources import given_or_shipped
from tactile_localizer.ros.base.executable import run
from tactile_localizer.ros.base.managed_node import ManagedNode
from tactile_localizer.ros.conversions.timestamps import from_ns
from tactile_localizer.ros.parameters.adapter import PARAMETERS

STRAIN_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
_WARNING_PERIOD_S = 5.0


class AdapterNode(ManagedNode):
    """Subscribes to the drivers of tactile sensors and publishes what they feel as ``strain``."""

    def __init__(self) -> None:
        super().__init__("adapter", PARAMETERS)
        self._adapter: StrainAdapter | None = None
        self._subscriptions_made: list[Any] = []
        self._publisher: Any = None
        self._sequence = 0

    def configure(self) -> None:
        """Read the file and make the publisher."""
        self._adapter = load_adapter(given_or_shipped(self.parameters["adapter_file"], "config/adapters"))
        self._types = {topic: message_type(kind) for topic, kind in self._adapter.topics.items()}
        self._message = StrainVectors(
            phalanges=list(self._adapter.phalanges), channels=self._adapter.layout.counts
        )
        self._message.header.frame_id = self.parameters["frame_id"]
        self._publisher = self.create_lifecycle_publisher(StrainVectors, "strain", STRAIN_QOS)

    def activate(self) -> None:
        """Subscribe."""
        assert self._adapter is not None
        self._adapter.reset()
        self._subscriptions_made = [
            self.create_subscription(kind, topic, partial(self._take, topic), STRAIN_QOS)
            for topic, kind in self._types.items()
        ]

    def deactivate(self) -> None:
        """End the subscriptions."""
        for subscription in self._subscriptions_made:
            self.destroy_subscription(subscription)
        self._subscriptions_made = []

    def cleanup(self) -> None:
        """Destroy the publisher."""
        if self._publisher is not None:
            self.destroy_lifecycle_publisher(self._publisher)
            self._publisher = None
        self._adapter = None

    def _take(self, topic: str, message: Any) -> None:
        assert self._adapter is not None
        try:
            vector = self._adapter.feed(topic, message, self.get_clock().now().nanoseconds)
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


def message_type(kind: str) -> Any:
    """The Python class of a message type such as ``geometry_msgs/msg/WrenchStamped``.

    Raises
    ------
    ParameterError
        No package of that name is installed, or it has no such message.
    """
    package, _, name = kind.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        raise ParameterError(f"type {kind}: expected a message type that is installed, found none") from None


def main() -> int:
    """Run the node; returns the exit status."""
    return run(AdapterNode)
