"""What the watcher hears of a running system, kept as far as the demonstration needs it."""

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

from tactile_localizer.evaluation.live_sweep import Contact, LiveSweep
from tactile_localizer.msg import Posterior, ScanStatus, StrainVectors
from tactile_localizer.nodes.stamps import to_ns
from tactile_localizer.sim.hand import PHALANGES

_BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
_RELIABLE = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
_KEPT = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@dataclass(frozen=True)
class Topic:
    """A topic that is listened to: the kind of its messages and the quality of service."""

    kind: Any
    quality: QoSProfile

    @property
    def type_name(self) -> str:
        """As bags name it."""
        return f"{self.kind.__module__.split('.')[0]}/msg/{self.kind.__name__}"


TOPICS = {
    "strain": Topic(StrainVectors, _BEST_EFFORT),
    "palm_pose": Topic(PoseStamped, _RELIABLE),
    "simulator/ground_truth": Topic(PoseStamped, _RELIABLE),
    "simulator/sweep_active": Topic(Bool, _KEPT),
    "mapping/status": Topic(ScanStatus, _KEPT),
    "filter/posterior": Topic(Posterior, _RELIABLE),
    "filter/particles": Topic(PointCloud2, _RELIABLE),
    "/diagnostics": Topic(DiagnosticArray, _RELIABLE),
}


@dataclass(frozen=True)
class Believed:
    """One posterior: stamp of its strain, mean (2,), covariance (2, 2), and whether it may be believed."""

    stamp_ns: int
    mean: np.ndarray
    covariance: np.ndarray
    converged: bool
    reason: str
    evidence: float


class Heard:
    """What was heard; filled by the watcher's thread, read by any other.

    Attributes
    ----------
    posteriors : since the sweep began
    truths : stamp (ns), x and y (m) since the sweep began
    active : whether the palm was sweeping, each time that it was told
    status : of the scan, newest
    particles : (P, 3) x and y (m) and weight, newest
    diagnostics : values by name, newest of each status
    """

    def __init__(self) -> None:
        self.posteriors: list[Believed] = []
        self.truths: list[tuple[int, float, float]] = []
        self.active: list[bool] = []
        self.status: Any = None
        self.particles = np.zeros((0, 3))
        self.diagnostics: dict[str, dict[str, str]] = {}

    def work_of(self, topic: str) -> Callable[[Any], None] | None:
        """What is done with a topic's messages."""
        return {
            "simulator/ground_truth": self._on_truth,
            "simulator/sweep_active": lambda message: self.active.append(message.data),
            "mapping/status": self._on_status,
            "filter/posterior": self._on_posterior,
            "filter/particles": self._on_particles,
            "/diagnostics": self._on_diagnostics,
        }.get(topic)

    def begin_sweep(self) -> None:
        """Forget the sweep before."""
        self.posteriors = []
        self.truths = self.truths[-1:]

    @property
    def sweep_is_over(self) -> bool:
        """Whether the palm has swept and is at rest again."""
        return True in self.active and not self.active[-1]

    @property
    def is_mapped(self) -> bool:
        """Whether the mapping hears strain, whose stamp its status has, and palm poses."""
        poses = int(self.diagnostics.get("mapping: scan", {}).get("poses", 0))
        return self.status is not None and to_ns(self.status.header.stamp) > 0 and poses > 0

    @property
    def is_diagnosed(self) -> bool:
        """Whether the filter and each load cell have told about themselves."""
        told = self.diagnostics
        return "filter: belief" in told and sum("drops" in values for values in told.values()) >= len(
            PHALANGES
        )

    @property
    def frames_dropped(self) -> int:
        """Frames that load cells sent and that are in no strain vector."""
        return sum(int(values["drops"]) for values in self.diagnostics.values() if "drops" in values)

    def localised(self, number: int, end_ns: int, contact: Contact | None) -> LiveSweep:
        """The sweep that is over: its estimates up to ``end_ns``, and the truth at their stamps."""
        truths = np.array(self.truths, dtype=np.float64)
        known_ns = np.array([stamp_ns for stamp_ns, _, _ in self.truths], dtype=np.int64)
        estimates = [one for one in self.posteriors if known_ns[0] <= one.stamp_ns <= end_ns]
        stamp_ns = np.array([one.stamp_ns for one in estimates], dtype=np.int64)
        since = known_ns[0]
        places = [np.interp(stamp_ns - since, known_ns - since, truths[:, column]) for column in (1, 2)]
        return LiveSweep(
            number=number,
            stamp_ns=stamp_ns,
            mean=np.array([one.mean for one in estimates]),
            truth=np.stack(places, axis=1),
            trace=np.array([np.trace(one.covariance) for one in estimates]),
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
            self.posteriors.append(
                Believed(
                    to_ns(message.header.stamp),
                    np.array(message.mean),
                    np.reshape(message.covariance, (2, 2)),
                    message.converged,
                    message.reason,
                    message.evidence,
                )
            )

    def _on_particles(self, message: PointCloud2) -> None:
        points = np.frombuffer(message.data, dtype="<f4").reshape(message.width, -1)
        self.particles = points[:, [0, 1, -1]].astype(np.float64)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.diagnostics[status.name] = {value.key: value.value for value in status.values}
