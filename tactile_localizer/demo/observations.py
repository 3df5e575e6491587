"""Messages that the demonstration receives, shows and evaluates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Bool

from tactile_localizer.demo.live_sweep import Contact, LiveSweep
from tactile_localizer.msg import Posterior, ScanStatus, StrainVectors
from tactile_localizer.ros.conversions.timestamps import to_ns
from tactile_localizer.sim.hand import PHALANGES

_BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
_RELIABLE = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
_LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@dataclass(frozen=True)
class Topic:
    """A subscribed topic: message type and quality of service."""

    kind: Any
    quality: QoSProfile

    @property
    def type_name(self) -> str:
        """Name of the message type, as in bags."""
        return f"{self.kind.__module__.split('.')[0]}/msg/{self.kind.__name__}"


TOPICS = {
    "strain": Topic(StrainVectors, _BEST_EFFORT),
    "palm_pose": Topic(PoseStamped, _RELIABLE),
    "simulator/ground_truth": Topic(PoseStamped, _RELIABLE),
    "simulator/sweep_active": Topic(Bool, _LATCHED),
    "mapping/status": Topic(ScanStatus, _LATCHED),
    "filter/posterior": Topic(Posterior, _RELIABLE),
    "filter/particles": Topic(PointCloud2, _RELIABLE),
    "/diagnostics": Topic(DiagnosticArray, _RELIABLE),
}


class Observations:
    """Received messages; written by the thread of the watcher, read by others.

    Attributes
    ----------
    posteriors : posteriors since the beginning of the sweep that are not stale
    truths : stamps (ns) and true positions x, y (m) since the beginning of the sweep
    active : received values of ``simulator/sweep_active``
    status : newest status of the scan
    particles : (P, 3) newest particles: x and y (m) and weight
    diagnostics : newest values of each diagnostic status, by its name
    """

    def __init__(self) -> None:
        self.posteriors: list[Posterior] = []
        self.truths: list[tuple[int, float, float]] = []
        self.active: list[bool] = []
        self.status: Any = None
        self.particles = np.zeros((0, 3))
        self.diagnostics: dict[str, dict[str, str]] = {}

    def callback_for(self, topic: str) -> Callable[[Any], None] | None:
        """Callback for the messages of a topic; ``None`` if they are only recorded."""
        return {
            "simulator/ground_truth": self._on_truth,
            "simulator/sweep_active": lambda message: self.active.append(message.data),
            "mapping/status": self._on_status,
            "filter/posterior": self._on_posterior,
            "filter/particles": self._on_particles,
            "/diagnostics": self._on_diagnostics,
        }.get(topic)

    def begin_sweep(self) -> None:
        """Discard the previous sweep."""
        self.posteriors = []
        self.truths = self.truths[-1:]

    @property
    def sweep_is_over(self) -> bool:
        """Whether a sweep has begun and ended."""
        return True in self.active and not self.active[-1]

    @property
    def is_mapped(self) -> bool:
        """Whether the mapping node receives strain and palm poses, according to its status."""
        poses = int(self.diagnostics.get("mapping: scan", {}).get("poses", 0))
        return self.status is not None and to_ns(self.status.header.stamp) > 0 and poses > 0

    @property
    def is_diagnosed(self) -> bool:
        """Whether diagnostics of the filter and of every load cell were received."""
        load_cells = sum("drops" in values for values in self.diagnostics.values())
        return "filter: belief" in self.diagnostics and load_cells >= len(PHALANGES)

    @property
    def frames_dropped(self) -> int:
        """Number of frames of the load cells that are missing from the strain vectors."""
        return sum(int(values["drops"]) for values in self.diagnostics.values() if "drops" in values)

    @property
    def estimated_ns(self) -> int:
        """Stamp of the newest posterior, ns; 0 before the first."""
        return to_ns(self.posteriors[-1].header.stamp) if self.posteriors else 0

    def localized_sweep(self, number: int, end_ns: int, contact: Contact | None) -> LiveSweep:
        """The finished sweep: estimates up to ``end_ns``, and the interpolated truth at their stamps."""
        known = list(self.truths)  # the watcher may append meanwhile
        truths = np.array(known, dtype=np.float64)
        known_ns = np.array([stamp_ns for stamp_ns, _, _ in known], dtype=np.int64)
        since_ns = known_ns[0]
        estimates = [one for one in self.posteriors if since_ns <= to_ns(one.header.stamp) <= end_ns]
        stamp_ns = np.array([to_ns(one.header.stamp) for one in estimates], dtype=np.int64)
        truth = [np.interp(stamp_ns - since_ns, known_ns - since_ns, truths[:, axis]) for axis in (1, 2)]
        return LiveSweep(
            number=number,
            stamp_ns=stamp_ns,
            mean=np.array([one.mean for one in estimates]),
            truth=np.stack(truth, axis=1),
            trace=np.array([one.covariance_trace for one in estimates]),
            converged=np.array([one.converged for one in estimates]),
            contact=contact,
        )

    def _on_truth(self, message: PoseStamped) -> None:
        place = message.pose.position
        self.truths.append((to_ns(message.header.stamp), place.x, place.y))

    def _on_status(self, message: ScanStatus) -> None:
        self.status = message

    def _on_posterior(self, message: Posterior) -> None:
        if not message.stale:
            self.posteriors.append(message)

    def _on_particles(self, message: PointCloud2) -> None:
        points = np.frombuffer(message.data, dtype="<f4").reshape(message.width, -1)
        self.particles = points[:, [0, 1, -1]].astype(np.float64)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.diagnostics[status.name] = {value.key: value.value for value in status.values}
