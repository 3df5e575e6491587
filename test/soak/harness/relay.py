"""Stands between the sensors and who localises by them, and spoils what it passes on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy

from tactile_localizer.demo.watcher import Watcher
from tactile_localizer.msg import StrainVectors
from tactile_localizer.nodes.stamps import from_ns, to_ns

_BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)

SENT = {"strain": "sensed/strain", "palm_pose": "sensed/palm_pose"}
"""By topic, where the sensors are to publish what the relay passes on."""


class Relay:
    """Passes strain and palm poses on.

    Parameters
    ----------
    watcher : in whose thread it does so

    Attributes
    ----------
    stopped : topics that are not passed on
    clock_ns : what all stamps are shifted by, ns: a clock that was set
    spoil_strain, spoil_pose : change a message before it is passed on
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
        """Set a message's stamp to the shifted clock's; returns it, ns."""
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
    """What is well is passed on as it is."""
