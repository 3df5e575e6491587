"""Relay between the sensors and the other nodes, which can corrupt the messages that it forwards."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy

from tactile_localizer.demo.watcher import Watcher
from tactile_localizer.msg import StrainVectors
from tactile_localizer.ros.conversions.timestamps import from_ns, to_ns

_BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)

SENT = {"strain": "sensed/strain", "palm_pose": "sensed/palm_pose"}
"""Topics on which the sensors publish, by the topic to which the relay forwards them."""


class Relay:
    """Forwards strain and palm poses.

    Parameters
    ----------
    watcher : forwards in the thread of this watcher

    Attributes
    ----------
    stopped : topics that are not forwarded
    clock_ns : shift of all stamps, ns, which simulates a step of the clock
    spoil_strain, spoil_pose : modify a message before it is forwarded
    """

    def __init__(self, watcher: Watcher) -> None:
        self.stopped: frozenset[str] = frozenset()
        self.clock_ns = 0
        self.spoil_strain: Callable[[StrainVectors], None] = leave_alone
        self.spoil_pose: Callable[[PoseStamped], None] = leave_alone
        self._strain = watcher.publisher(StrainVectors, "strain", _BEST_EFFORT)
        self._pose = watcher.publisher(PoseStamped, "palm_pose", 100)
        watcher.listen(StrainVectors, SENT["strain"], _BEST_EFFORT, self._on_strain)
        watcher.listen(PoseStamped, SENT["palm_pose"], 100, self._on_pose)

    def shift(self, message: Any) -> int:
        """Shift the stamp of a message; returns the new stamp, ns."""
        stamp_ns = to_ns(message.header.stamp) + self.clock_ns
        message.header.stamp = from_ns(stamp_ns)
        return stamp_ns

    def _on_strain(self, message: StrainVectors) -> None:
        if "strain" not in self.stopped:
            self.shift(message)
            self.spoil_strain(message)
            self._strain.publish(message)

    def _on_pose(self, message: PoseStamped) -> None:
        if "palm_pose" not in self.stopped:
            self.shift(message)
            self.spoil_pose(message)
            self._pose.publish(message)


def leave_alone(message: Any) -> None:
    """Forward a message unchanged."""
