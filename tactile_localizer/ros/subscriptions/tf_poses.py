"""Palm poses looked up in tf at the stamps of the strain vectors.

``tf2_ros`` is imported only if a parameter requires it, so that the nodes run without it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseStamped, TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription
from rclpy.time import Time

from tactile_localizer.core.geometry.runs import NANOSECONDS
from tactile_localizer.errors import MeasurementError
from tactile_localizer.ros.base.parameters import import_optional

_TF = QoSProfile(depth=1000)
_TF_STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_REWIND_NS = NANOSECONDS
"""Backward jump of the strain stamps after which buffered transforms are discarded, ns."""


class PalmLookup:
    """Looks up the pose of ``palm_frame`` in ``reference_frame`` at the stamps of strain vectors.

    A stamp whose transform has not arrived is kept until strain is newer than it by ``patience_s``.

    Parameters
    ----------
    reference_frame, palm_frame : target and source frame of the lookup
    patience_s : time to wait for a transform, measured in stamps, s
    on_pose : called with each pose, in the order of the stamps
    on_failure : called with the reason if a lookup fails for good

    Raises
    ------
    ParameterError
        tf2_ros is not installed.
    """

    def __init__(
        self,
        reference_frame: str,
        palm_frame: str,
        patience_s: float,
        on_pose: Callable[[PoseStamped], None],
        on_failure: Callable[[MeasurementError], None],
    ) -> None:
        self._tf2 = import_optional("tf2_ros", "pose_source")
        self._message = import_optional("tf2_msgs.msg", "pose_source").TFMessage
        self._frames = reference_frame, palm_frame
        self._patience_ns = round(patience_s * NANOSECONDS)
        self._on_pose, self._on_failure = on_pose, on_failure
        self._waiting: deque[int] = deque()
        self._newest_ns = 0
        self._buffer = self._tf2.Buffer()

    def subscribe(self, node: Node) -> list[Subscription]:
        """Receive the transforms with subscriptions of a node, which are returned."""
        return [
            node.create_subscription(self._message, topic, partial(self._on_transforms, keep), qos)
            for topic, qos, keep in (
                ("/tf", _TF, self._buffer.set_transform),
                ("/tf_static", _TF_STATIC, self._buffer.set_transform_static),
            )
        ]

    def look_up(self, stamp_ns: int) -> None:
        """Look up the pose at the stamp of a strain vector, now or when its transform arrives."""
        if stamp_ns < self._newest_ns - _REWIND_NS:
            self._waiting.clear()
            self._buffer.clear()
            self._newest_ns = 0
        self._newest_ns = max(self._newest_ns, stamp_ns)
        self._waiting.append(stamp_ns)
        self._resolve()

    def _on_transforms(
        self, keep: Callable[[TransformStamped, str], None], message: Any, info: Mapping[str, int]
    ) -> None:
        for transform in message.transforms:
            keep(transform, "tf")
        self._resolve()

    def _resolve(self) -> None:
        while self._waiting:
            stamp_ns = self._waiting[0]
            try:
                transform = self._buffer.lookup_transform_core(*self._frames, Time(nanoseconds=stamp_ns))
            except self._tf2.TransformException as error:
                if self._can_still_succeed(stamp_ns, error):
                    return
                self._waiting.popleft()
                self._on_failure(MeasurementError(f"tf: {error}"))
            else:
                self._waiting.popleft()
                self._on_pose(_to_pose(transform))

    def _can_still_succeed(self, stamp_ns: int, error: Exception) -> bool:
        """Whether a failed lookup can succeed with transforms that arrive later."""
        if isinstance(error, self._tf2.ExtrapolationException) and self._latest_ns() >= stamp_ns:
            return False
        return self._newest_ns - stamp_ns <= self._patience_ns

    def _latest_ns(self) -> int:
        """Latest stamp for which the transform is available, ns; 0 if it is unavailable."""
        try:
            return int(self._buffer.get_latest_common_time(*self._frames).nanoseconds)
        except self._tf2.TransformException:
            return 0


def _to_pose(transform: TransformStamped) -> PoseStamped:
    message = PoseStamped(header=transform.header)
    place = transform.transform.translation
    message.pose.position.x, message.pose.position.y, message.pose.position.z = place.x, place.y, place.z
    message.pose.orientation = transform.transform.rotation
    return message
