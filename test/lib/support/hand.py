"""A hand controlled by a test: publishes poses and strain, and records them like a bag."""

from __future__ import annotations

from typing import Any

import numpy as np
from support import bags
from support.sweeps import stamp_of

DEEP_QUEUE = {
    "queue_depth": 1000,
    **{f"qos_overrides./{topic}.subscription.reliability": "reliable" for topic in ("strain", "palm_pose")},
}
"""Parameters with which a starved node loses no strain and no pose."""


class Hand:
    """Publishes poses every 20 ms and strain every 5 ms of a path along x, by stamps alone.

    ``published`` has the messages in the form of :func:`support.bags.write_bag`.
    """

    def __init__(
        self, probe, frame="material", phalanges=("middle", "index", "thumb"), node="tactile_mapping"
    ):
        from geometry_msgs.msg import PoseStamped

        from tactile_localizer.msg import ScanStatus, StrainVectors

        self.probe, self.frame, self.phalanges, self.node = probe, frame, phalanges, node
        self.statuses = probe.listen(ScanStatus, f"{node}/status", 100)
        self._publishers = {
            "palm_pose": probe.publisher(PoseStamped, "palm_pose", 10_000),
            "strain": probe.publisher(StrainVectors, "strain", 10_000),
        }
        probe.known_to(node)
        self.x = bags.x_at
        self.now_ms = 0
        self.published: list[tuple[str, int, bytes]] = []

    def _publish(self, topic: str, message: Any) -> None:
        raw = bytes(bags.STORE.serialize_cdr(message, bags.TYPES[topic]))
        self._publishers[topic].publish(raw)
        self.published.append((topic, len(self.published), raw))

    def send_pose(self, stamp_ms, x=None):
        self._publish("palm_pose", bags.pose(stamp_ms, self.frame, self.x(stamp_ms) if x is None else x))

    def send_strain(self, stamp_ms, status=(0, 0, 0), **changes):
        flags = np.array(status[: len(self.phalanges)], dtype=np.uint8)
        self._publish("strain", bags.strain(stamp_ms, self.phalanges, status=flags, **changes))

    def published_with_status(self):
        """The messages that it published, and the statuses that it received."""
        from rclpy.serialization import serialize_message

        first = len(self.published)
        received = [serialize_message(message) for message in self.statuses]
        return self.published + [
            ("tactile_mapping/status", first + index, raw) for index, raw in enumerate(received)
        ]

    def slide(self, duration_ms, poses=True, late_ms=0):
        """Publish poses and strain of the next ``duration_ms``, paced so that no message is lost.

        Poses are sent ``late_ms`` after the strain of their time.
        """
        for stamp_ms in range(self.now_ms + 1, self.now_ms + duration_ms + 1):
            if poses and stamp_ms % 20 == 0:
                self.send_pose(stamp_ms - late_ms)
            if stamp_ms % 5 == 0:
                self.send_strain(stamp_ms)
                self.probe.executor.spin_once(timeout_sec=0.002)
        self.now_ms += duration_ms

    def service(self, name):
        return self.probe.trigger(f"{self.node}/{name}")

    def wait_for_stamp(self, stamp_ms):
        """Wait until the node has processed the messages up to ``stamp_ms``, according to its status.

        The first status with this stamp shows that the strain was processed; poses that were sent before it
        may still be in their queue, which the executor serves before the next status.
        """
        wanted = bags.START + stamp_ms * bags.MS
        self.probe.until(
            lambda: sum(stamp_of(status) >= wanted for status in self.statuses) >= 2,
            f"two statuses at {stamp_ms} ms",
        )
