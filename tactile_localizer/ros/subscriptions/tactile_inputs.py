"""Strain vectors and palm poses that a node receives, paired by their stamps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from tactile_localizer.core.geometry.palm_frame import PalmFrame
from tactile_localizer.core.geometry.runs import NANOSECONDS
from tactile_localizer.core.geometry.synchronization import (
    DEFAULT_MAX_GAP_S,
    DEFAULT_PATIENCE_S,
    Pair,
    Pairing,
)
from tactile_localizer.errors import MeasurementError, ParameterError, TactileLocalizerError
from tactile_localizer.io.scans.recorder import StrainSample
from tactile_localizer.io.strain_vectors import StrainReader
from tactile_localizer.msg import StrainVectors
from tactile_localizer.ros.base.managed_node import ManagedNode
from tactile_localizer.ros.base.parameters import Parameter
from tactile_localizer.ros.conversions import to_ns
from tactile_localizer.ros.subscriptions.tf_poses import PalmLookup
from tactile_localizer.scene import Axis, Scene

_Pairs = list[Pair[StrainSample]]

SYNCHRONIZATION = (
    Parameter(
        "max_gap_s", DEFAULT_MAX_GAP_S, "Longest interval between poses that is interpolated", "s", 0.0, 10.0
    ),
    Parameter(
        "patience_s",
        DEFAULT_PATIENCE_S,
        "Time, measured in stamps, that a strain vector waits for a late pose",
        "s",
        0.0,
        60.0,
    ),
    Parameter(
        "queue_depth",
        100,
        "Messages of strain and of poses that wait while the node is busy; DDS drops older ones",
        "",
        1,
        100_000,
    ),
)
"""Queues, and synchronization of poses with strain vectors."""

FRAMES = (
    Parameter(
        "pose_source",
        "topic",
        "Source of palm poses: topic palm_pose, or lookup in tf at the stamp of the strain vector",
        choices=("topic", "tf"),
    ),
    Parameter("palm_frame", "palm", "Frame of the palm, looked up in reference_frame if pose_source is tf"),
    Parameter("material_frame", "material", "Frame of the material; palm poses in it are used unchanged"),
    Parameter(
        "reference_frame",
        "base_link",
        "Other accepted frame of palm poses, transformed by material_pose; empty for none",
    ),
    Parameter(
        "material_pose",
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        "Pose of material_frame in reference_frame: x, y, z, roll, pitch, yaw",
        "m, rad",
    ),
)
"""Source and frames of the poses."""


class TactileInputs:
    """Receives strain and palm poses, and passes on the pairs that they make; :meth:`start` it first.

    Parameters
    ----------
    node : its parameters include :data:`SYNCHRONIZATION` and :data:`FRAMES`
    on_pairs : called with the pairs that a message completes, in the order of their stamps

    Attributes
    ----------
    pairing : pairing of the strain vectors with poses
    received, invalid : numbers of messages and of invalid ones, by topic: ``strain`` and ``palm_pose``
    problems : why the last message of a topic was invalid; without the topics whose last one was valid

    Raises
    ------
    ParameterError
        ``material_pose`` is not six finite numbers. With ``pose_source`` tf: tf2_ros is not installed, or
        ``reference_frame`` is empty.
    """

    def __init__(self, node: ManagedNode, on_pairs: Callable[[_Pairs], None]) -> None:
        self._node, self._on_pairs = node, on_pairs
        self._lookup: PalmLookup | None = None
        if node.parameters["pose_source"] == "tf":
            frames = node.parameters["reference_frame"], node.parameters["palm_frame"]
            if not frames[0]:
                raise ParameterError("reference_frame: expected the target of the lookup in tf, got none")
            failed = partial(self.reject, "palm_pose")
            self._lookup = PalmLookup(*frames, node.parameters["patience_s"], self._on_pose, failed)
        self._frame = self._palm_frame(())  # rejects an invalid pose before a scan is loaded

    def start(self, scene: Scene) -> None:
        """Begin anew with the axes and phalanges of a scene: the next messages do not continue the last."""
        parameters = self._node.parameters
        self._frame = self._palm_frame(scene.axes)
        self._reader = StrainReader(scene)
        self.pairing: Pairing[StrainSample] = Pairing(
            scene.axes, max_gap_s=parameters["max_gap_s"], patience_s=parameters["patience_s"]
        )
        self.received: Counter[str] = Counter()
        self.invalid: Counter[str] = Counter()
        self._ahead_ns: dict[str, int] = {}  # newest pose after the newest strain when a topic last arrived
        self.problems: dict[str, str] = {}

    def subscribe(self) -> None:
        """Subscribe to strain and poses, best effort: reliable publishers match too."""
        depth = self._node.parameters["queue_depth"]
        overridden = QoSOverridingOptions((QoSPolicyKind.RELIABILITY,))
        best_effort = QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
        subscribe = partial(
            self._node.create_subscription, qos_profile=best_effort, qos_overriding_options=overridden
        )
        subscribe(StrainVectors, "strain", self._on_strain)
        if self._lookup is None:
            subscribe(PoseStamped, "palm_pose", self._on_pose)
        else:
            self._lookup.subscribe(self._node)

    @property
    def lost(self) -> int:
        """Number of strain vectors lost in transport."""
        return self._reader.lost

    @property
    def newest_ns(self) -> int:
        """Stamp of the newest strain vector, ns; 0 before the first."""
        return self.pairing.newest_ns or 0

    def misalignment(self, tolerance_s: float) -> str:
        """How far the stamps of poses are from those of the strain that arrives with them.

        Empty within ``tolerance_s``. A topic that stops is not misaligned.
        """
        if len(self._ahead_ns) < 2:  # both topics
            return ""
        ahead_s = min(self._ahead_ns.values(), key=abs) / NANOSECONDS
        if abs(ahead_s) <= tolerance_s:
            return ""
        way = "ahead of" if ahead_s > 0.0 else "behind"
        return f"palm_pose: stamps are {abs(ahead_s):.1f} s {way} the strain"

    def position(self, message: PoseStamped) -> np.ndarray:
        """The palm's position on the scene's axes, (d,), m (yaw: rad).

        Raises
        ------
        MeasurementError
            The pose is in an unknown frame, or not finite.
        """
        point, turn = message.pose.position, message.pose.orientation
        return self._frame.position(
            message.header.frame_id, (point.x, point.y, point.z), (turn.x, turn.y, turn.z, turn.w)
        )

    def reject(self, topic: str, error: TactileLocalizerError) -> None:
        """Count and log an invalid message."""
        self.invalid[topic] += 1
        self.problems[topic] = f"{topic}: {error}"
        self._node.get_logger().error(self.problems[topic], throttle_duration_sec=1.0)

    def _palm_frame(self, axes: tuple[Axis, ...]) -> PalmFrame:
        parameters = self._node.parameters
        return PalmFrame(
            axes, parameters["material_frame"], parameters["reference_frame"], parameters["material_pose"]
        )

    def _on_strain(self, message: StrainVectors) -> None:
        self._take("strain", message, self.pairing.add_strain, self._reader.read)
        if self._lookup is not None and (stamp_ns := to_ns(message.header.stamp)):
            self._lookup.look_up(stamp_ns)

    def _on_pose(self, message: PoseStamped) -> None:
        self._take("palm_pose", message, self.pairing.add_pose, self.position)

    def _take(
        self, topic: str, message: Any, add: Callable[[int, Any], _Pairs], read: Callable[[Any], Any]
    ) -> None:
        """Pass on the pairs that a message completes, or reject it."""
        self.received[topic] += 1
        try:
            if not (stamp_ns := to_ns(message.header.stamp)):
                raise MeasurementError("expected a stamp, found 0: the clock of the sender has not started")
            pairs = add(stamp_ns, read(message))
        except TactileLocalizerError as error:
            self.reject(topic, error)
        else:
            self.problems.pop(topic, None)
            strain_ns, pose_ns = self.pairing.newest_ns, self.pairing.newest_pose_ns
            if strain_ns is not None and pose_ns is not None:
                self._ahead_ns[topic] = pose_ns - strain_ns
            self._on_pairs(pairs)
