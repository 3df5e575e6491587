"""A hand controlled by a test: publishes poses and strain, and records them like a bag."""

from __future__ import annotations

from support.bags import MS, START

DEEP_QUEUE = {"queue_depth": 1000}
"""Parameter with which a starved node loses no strain."""


class Hand:
    """Publishes poses every 20 ms and strain every 5 ms of a path along x, by stamps alone.

    ``published`` has the messages in the form of :func:`support.bags.write_bag`.
    """

    def __init__(self, probe, frame="material", phalanges=("middle", "index", "thumb"), node="mapping"):
        from geometry_msgs.msg import PoseStamped
        from rclpy.qos import QoSProfile, ReliabilityPolicy

        from tactile_localizer.msg import ScanStatus, StrainVectors

        self.probe, self.frame, self.phalanges, self.node = probe, frame, phalanges, node
        best_effort = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.Pose, self.Strain = PoseStamped, StrainVectors
        self.statuses = probe.listen(ScanStatus, f"{node}/status", 100)
        self.poses = probe.publisher(PoseStamped, "palm_pose", 100)
        self.strain = probe.publisher(StrainVectors, "strain", best_effort)
        probe.known_to(node)
        self.now_ms = 0
        self.published = []

    @staticmethod
    def x(stamp_ms):
        return 0.01 + 0.00001 * stamp_ms

    def stamp(self, message, stamp_ms):
        total = START + stamp_ms * MS
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(total, 1_000_000_000)

    def publish(self, publisher, topic, message):
        from rclpy.serialization import serialize_message

        publisher.publish(message)
        self.published.append((topic, len(self.published), serialize_message(message)))

    def published_with_status(self):
        """The messages that it published, and the statuses that it received."""
        from rclpy.serialization import serialize_message

        first = len(self.published)
        received = [serialize_message(message) for message in self.statuses]
        return self.published + [("mapping/status", first + index, raw) for index, raw in enumerate(received)]

    def send_pose(self, stamp_ms):
        message = self.Pose()
        self.stamp(message, stamp_ms)
        message.header.frame_id = self.frame
        message.pose.position.x, message.pose.position.y = self.x(stamp_ms), 0.02
        message.pose.orientation.w = 1.0
        self.publish(self.poses, "palm_pose", message)

    def send_strain(self, stamp_ms, status=(0, 0, 0)):
        message = self.Strain()
        self.stamp(message, stamp_ms)
        message.phalanges = list(self.phalanges)
        message.strain = [float(stamp_ms + 1000 * gauge) for gauge in range(8 * len(self.phalanges))]
        message.status = list(status)[: len(self.phalanges)]
        message.sequence = [stamp_ms] * len(self.phalanges)
        self.publish(self.strain, "strain", message)

    def slide(self, duration_ms, poses=True):
        """Publish poses and strain of the next ``duration_ms``, paced so that no message is lost."""
        for stamp_ms in range(self.now_ms + 1, self.now_ms + duration_ms + 1):
            if poses and stamp_ms % 20 == 0:
                self.send_pose(stamp_ms)
            if stamp_ms % 5 == 0:
                self.send_strain(stamp_ms)
                self.probe.executor.spin_once(timeout_sec=0.002)
        self.now_ms += duration_ms

    def service(self, name):
        from std_srvs.srv import Trigger

        return self.probe.call(Trigger, f"{self.node}/{name}")

    def wait_for_stamp(self, stamp_ms):
        """Wait until the node has processed the messages up to ``stamp_ms``, according to its status.

        The first status with this stamp shows that the strain was processed; poses that were sent before it
        may still be in their queue, which the executor serves before the next status.
        """
        wanted = START + stamp_ms * MS
        self.probe.until(
            lambda: sum(stamp_of(status) >= wanted for status in self.statuses) >= 2,
            f"two statuses at {stamp_ms} ms",
        )


def stamp_of(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
