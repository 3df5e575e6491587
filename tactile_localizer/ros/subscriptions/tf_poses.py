"""Palm poses looked up in tf at the stamps of strain.

``tf2_ros`` is imported only where a parameter asks for it, so that the nodes run without.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PoseStamped, TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time

from tactile_localizer.core.geometry.pose_buffer import NANOSECONDS
from tactile_localizer.errors import MeasurementError
from tactile_localizer.ros.base.optional_imports import import_optional
from tactile_localizer.ros.subscriptions.draining import Topic

_TF = QoSProfile(depth=100)
_TF_STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_REWIND_NS = NANOSECONDS
"""Step back of a strain's stamp, ns, after which what tf has buffered is of another time."""


class PalmLookup:
    """Looks up the palm in tf at the stamps of strain.

    A transform that is not there yet is waited for, by stamps, until strain is newer by ``patience_s``.

    Parameters
    ----------
    reference_frame, palm_frame : the pose of the second in the first is looked up
    patience_s : how long, by stamps, a stamp waits for its transform, s
    found : receives each pose, in the order of the stamps
    missed : receives why a stamp that waited in vain has none

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
        found: Callable[[PoseStamped], None],
        missed: Callable[[MeasurementError], None],
    ) -> None:
        self._tf2 = import_optional("tf2_ros", "pose_source")
        self._message = import_optional("tf2_msgs.msg", "pose_source").TFMessage
        self._frames = reference_frame, palm_frame
        self._patience_ns = round(patience_s * NANOSECONDS)
        self._found, self._missed = found, missed
        self._waiting: deque[int] = deque()
        self._newest_ns = 0
        self._buffer = self._tf2.Buffer()

    def topics(self) -> list[Topic]:
        """What is subscribed to."""
        return [
            Topic(self._message, "/tf", self._on_transforms, _TF),
            Topic(self._message, "/tf_static", self._on_static_transforms, _TF_STATIC),
        ]

    def look_up(self, stamp_ns: int) -> None:
        """Find the pose at a strain's stamp, now or when its transform arrives."""
        if stamp_ns < self._newest_ns - _REWIND_NS:
            self._waiting.clear()
            self._buffer.clear()
            self._newest_ns = 0
        self._newest_ns = max(self._newest_ns, stamp_ns)
        self._waiting.append(stamp_ns)
        self._work_off()

    def _on_transforms(self, message: Any) -> None:
        for transform in message.transforms:
            self._buffer.set_transform(transform, "/tf")
        self._work_off()

    def _on_static_transforms(self, message: Any) -> None:
        for transform in message.transforms:
            self._buffer.set_transform_static(transform, "/tf_static")
        self._work_off()

    def _work_off(self) -> None:
        while self._waiting:
            stamp_ns = self._waiting[0]
            try:
                found = self._buffer.lookup_transform_core(*self._frames, Time(nanoseconds=stamp_ns))
            except self._tf2.TransformException as error:
                if self._may_come(stamp_ns, error):
                    return
                self._waiting.popleft()
                self._missed(MeasurementError(f"tf: {error}"))
            else:
                self._waiting.popleft()
                self._found(_pose(found))

    def _may_come(self, stamp_ns: int, error: Exception) -> bool:
        """Whether a transform that is not there is worth waiting for."""
        if isinstance(error, self._tf2.ExtrapolationException) and self._latest_ns() >= stamp_ns:
            return False
        return self._newest_ns - stamp_ns <= self._patience_ns

    def _latest_ns(self) -> int:
        """Stamp up to which the transform is there, ns; 0 where it is not."""
        try:
            return int(self._buffer.get_latest_common_time(*self._frames).nanoseconds)
        except self._tf2.TransformException:
            return 0


def _pose(transform: TransformStamped) -> PoseStamped:
    message = PoseStamped(header=transform.header)
    place = transform.transform.translation
    message.pose.position.x, message.pose.position.y, message.pose.position.z = place.x, place.y, place.z
    message.pose.orientation = transform.transform.rotation
    return message
