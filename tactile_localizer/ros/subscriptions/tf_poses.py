"""Palm poses from tf.

``tf2_ros`` is imported only if a parameter requires it, so that the nodes run without it.
"""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseStamped, TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription

from tactile_localizer.errors import did_you_mean, listed, printable
from tactile_localizer.ros.base.parameters import import_optional
from tactile_localizer.streams.runs import NANOSECONDS, to_ns

_TF = QoSProfile(depth=1000)
_TF_STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_REWIND_NS = NANOSECONDS
"""Backward jump of the stamps of a frame after which buffered transforms are discarded, ns."""


class TfPoses:
    """Poses of ``palm_frame`` in ``reference_frame``, one whenever all transforms between them are newer.

    This stream is as that of a topic, with the same rules for gaps and late messages.

    Parameters
    ----------
    reference_frame, palm_frame : target and source frame of the lookup
    on_pose : called with each pose, in the order of the stamps

    Raises
    ------
    ParameterError
        tf2_ros is not installed.
    """

    def __init__(self, reference_frame: str, palm_frame: str, on_pose: Callable[[PoseStamped], None]) -> None:
        self._tf2 = import_optional("tf2_ros", "pose_source")
        self._message = import_optional("tf2_msgs.msg", "pose_source").TFMessage
        self._frames, self._on_pose = (reference_frame, palm_frame), on_pose
        self._buffer = self._tf2.Buffer()
        self._known: set[str] = set()
        self._invalid: set[str] = set()  # child frames whose newest transform was
        self._reason = ""
        self._newest_ns: dict[str, int] = {}  # by child frame
        self._published_ns = 0

    def subscribe(self, node: Node) -> list[Subscription]:
        """Receive the transforms with subscriptions of a node, which are returned."""
        return [
            node.create_subscription(self._message, topic, partial(self._on_transforms, keep), qos)
            for topic, qos, keep in (
                ("/tf", _TF, self._keep),
                ("/tf_static", _TF_STATIC, self._buffer.set_transform_static),
            )
        ]

    def _keep(self, transform: TransformStamped, authority: str) -> None:
        stamp_ns = to_ns(transform.header.stamp)
        if stamp_ns < self._newest_ns.get(transform.child_frame_id, 0) - _REWIND_NS:
            self._buffer.clear()
            self._newest_ns.clear()
            self._published_ns = 0
        self._newest_ns[transform.child_frame_id] = stamp_ns
        self._buffer.set_transform(transform, authority)

    def _on_transforms(
        self, keep: Callable[[TransformStamped, str], None], message: Any, info: Mapping[str, int]
    ) -> None:
        for transform in message.transforms:
            parent, child = transform.header.frame_id, transform.child_frame_id
            if parent and child and _is_finite(transform):  # tf2 would log each other one
                keep(transform, "tf")
                self._known |= {parent.lstrip("/"), child.lstrip("/")}
                self._invalid.discard(child)
            else:
                self._invalid.add(child)
        try:
            common = self._buffer.get_latest_common_time(*self._frames)
            transform = self._buffer.lookup_transform_core(*self._frames, common)
        except self._tf2.TransformException as error:
            self._reason = str(error).partition("\n")[0]  # the other lines list all frames
            return
        self._reason = "no newer one" if common.nanoseconds else "static, or without a stamp"
        if common.nanoseconds > self._published_ns:
            self._published_ns = common.nanoseconds
            self._on_pose(_to_pose(transform))

    @property
    def problem(self) -> str:
        """Why tf has no newer pose, in one line; empty before the first transform."""
        if unknown := sorted({*self._frames} - self._known):
            known = sorted(self._known)
            reason = f"no {unknown[0]}{did_you_mean(unknown[0], known)} among {listed(known)}"
        else:
            reason = self._reason
        if self._invalid:
            reason = f"not finite, or without a frame: transform to {listed(sorted(self._invalid))}"
        reference, palm = self._frames
        text = f"from reference_frame {reference} to palm_frame {palm}: {reason}"
        return printable(text) if self._known or self._invalid else ""


def _is_finite(transform: TransformStamped) -> bool:
    """Whether a transform is finite and can rotate."""
    place, turn = transform.transform.translation, transform.transform.rotation
    norm = math.hypot(turn.x, turn.y, turn.z, turn.w)
    return norm > 0.0 and math.isfinite(norm + place.x + place.y + place.z)


def _to_pose(transform: TransformStamped) -> PoseStamped:
    message = PoseStamped(header=transform.header)
    place = transform.transform.translation
    message.pose.position.x, message.pose.position.y, message.pose.position.z = place.x, place.y, place.z
    message.pose.orientation = transform.transform.rotation
    return message
