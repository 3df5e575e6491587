"""Hands controlled by a test: one that slides as in a bag, and one with the strain of a simulated sweep."""

from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import serialize_message
from support import bags

from tactile_localizer.io.recording import RecordedSweep
from tactile_localizer.msg import ScanStatus, StrainVectors

DEEP_QUEUE = {
    "queue_depth": 1000,
    **{f"qos_overrides./{topic}.subscription.reliability": "reliable" for topic in ("strain", "palm_pose")},
}
"""Parameters with which a starved node loses no strain and no pose."""


class Hand:
    """Publishes poses every 20 ms and strain every 5 ms of a path along x, by stamps alone.

    ``published`` has the messages in the form of :func:`support.bags.write_bag`.
    """

    def __init__(self, probe: Any, node: str) -> None:
        self.probe, self.node = probe, node
        self.frame, self.phalanges = "material", ("middle", "index", "thumb")
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


class SlidingHand:
    """Publishes a simulated sweep: strain at its samples, poses halfway between them.

    Parameters
    ----------
    probe : a :class:`support.probe.Probe`
    sweep : sweep to publish
    topics : topics of strain and poses
    poses : whether the node under test subscribes to the poses
    """

    def __init__(
        self,
        probe: Any,
        sweep: RecordedSweep,
        topics: tuple[str, str] = ("strain", "palm_pose"),
        *,
        poses: bool = True,
    ) -> None:
        self._probe = probe
        self._poses = probe.publisher(PoseStamped, topics[1], 100) if poses else None
        self._strains = probe.publisher(StrainVectors, topics[0], probe.best_effort)
        self.sweep = sweep
        self.offset_ns = bags.START
        self.next = 0
        stamp_ns = sweep.stamp_ns - sweep.stamp_ns[0]
        self.strain_ns = stamp_ns + int(stamp_ns[1]) // 2
        self.pose_ns = stamp_ns

    def slide(self, samples: int, *, poses: bool = True, strain: bool = True, **changes: Any) -> None:
        """Publish the next ``samples``, paced so that best effort loses nothing.

        ``changes`` replace fields of the strain messages.
        """
        for k in range(self.next, self.next + samples):
            if poses:
                self.send_pose(k)
            if strain:
                self.send_strain(k, **changes)
            self._probe.executor.spin_once(timeout_sec=0.002)
        self.next += samples
        if poses:
            self.send_pose(self.next)

    def send_pose(self, k: int) -> None:
        message = PoseStamped()
        set_stamp(message, self.offset_ns + int(self.pose_ns[k]))
        message.header.frame_id = "base_link"
        message.pose.position.x, message.pose.position.y = map(float, self.sweep.position[k])
        message.pose.orientation.w = 1.0
        self._poses.publish(message)

    def send_strain(self, k: int, **changes: Any) -> None:
        message = StrainVectors()
        set_stamp(message, self.offset_ns + int(self.strain_ns[k]))
        message.phalanges, message.status, message.sequence = ["index", "middle"], [0, 0], [k, k]
        message.strain = self.sweep.strain[k].tolist()
        for name, value in changes.items():
            setattr(message, name, value)
        self._strains.publish(message)

    def sample_of(self, message: Any) -> int:
        """Index of the strain vector with the stamp of a message."""
        return int(np.flatnonzero(self.strain_ns == stamp_of(message) - self.offset_ns)[0])


def set_stamp(message: Any, stamp_ns: int) -> None:
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)


def stamp_of(message: Any) -> int:
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
