"""The seam to tf: palm poses looked up in it, and the material's pose published to it.

``tf2_ros`` is imported only where a parameter asks for it, so that the nodes run without.
"""

from __future__ import annotations

import importlib
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, TransformStamped
from rclpy.lifecycle import LifecycleNodeMixin
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from scipy.spatial.transform import Rotation

from tactile_localizer.core.geometry.pose_buffer import NANOSECONDS
from tactile_localizer.core.localizer import Estimate
from tactile_localizer.errors import MeasurementError, ParameterError
from tactile_localizer.nodes.hearing import Topic
from tactile_localizer.nodes.stamps import from_ns

_TF = QoSProfile(depth=100)
_TF_STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_REWIND_NS = NANOSECONDS
"""Step back of a strain's stamp, ns, after which what tf has buffered is of another time."""

PUBLISH_PERIOD_NS = 20_000_000
"""Least time, by stamps, between two published transforms, ns: planners and RViz want no more than 50 Hz."""


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
        self._tf2 = _imported("tf2_ros", "pose_source")
        self._message = _imported("tf2_msgs.msg", "pose_source").TFMessage
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


class MaterialBroadcaster:
    """Publishes where the material is, as a converged posterior implies: the child of ``reference_frame``.

    On axes that the scene does not model, the material lies as ``material_pose`` says.

    Parameters
    ----------
    node : the publisher's; it publishes while the node is active
    reference_frame, material_frame : parent and child
    material_pose : x, y, z (m), roll, pitch, yaw (rad) of the material that palm poses were brought into

    Raises
    ------
    ParameterError
        tf2_msgs is not installed, or ``reference_frame`` is empty.
    """

    def __init__(
        self,
        node: LifecycleNodeMixin,
        reference_frame: str,
        material_frame: str,
        material_pose: Sequence[float],
    ) -> None:
        if not reference_frame or reference_frame == material_frame:
            raise ParameterError(
                f"publish_tf: expected a reference_frame beside material_frame, got {reference_frame!r}"
            )
        self._message = _imported("tf2_msgs.msg", "publish_tf").TFMessage
        self._node, self._frames, self._material_pose = node, (reference_frame, material_frame), material_pose
        self._published_ns: int | None = None
        self._publisher = node.create_lifecycle_publisher(self._message, "/tf", _TF)

    def close(self) -> None:
        """Withdraw the topic."""
        self._node.destroy_lifecycle_publisher(self._publisher)

    def publish(self, estimate: Estimate, axes: tuple[str, ...], palm: np.ndarray) -> None:
        """The transform of a converged estimate; nothing for any other, or too soon after the last.

        Parameters
        ----------
        estimate : of the palm's position on the material
        axes : names of its axes
        palm : (d,) position of the palm, brought into ``material_pose``, that the estimate was made with
        """
        before_ns = self._published_ns
        if not estimate.converged or (
            before_ns is not None and 0 <= estimate.stamp_ns - before_ns < PUBLISH_PERIOD_NS
        ):
            return
        self._published_ns = estimate.stamp_ns
        translation, quaternion = material_in_reference(axes, palm, estimate.mean, self._material_pose)
        transform = TransformStamped(child_frame_id=self._frames[1])
        transform.header.frame_id, transform.header.stamp = self._frames[0], from_ns(estimate.stamp_ns)
        for name, value in zip("xyz", translation.tolist(), strict=True):
            setattr(transform.transform.translation, name, value)
        for name, value in zip("xyzw", quaternion.tolist(), strict=True):
            setattr(transform.transform.rotation, name, value)
        self._publisher.publish(self._message(transforms=[transform]))


def material_in_reference(
    axes: tuple[str, ...], palm: np.ndarray, mean: np.ndarray, material_pose: Sequence[float]
) -> tuple[np.ndarray, np.ndarray]:
    """Where the material is in the reference frame: translation (3,), m, and quaternion (4,), x y z w.

    With the palm at ``palm`` in the nominal material frame N and at ``mean`` on the material M,
    ``T_reference_M = T_reference_N T_N_palm inv(T_M_palm)``.

    Parameters
    ----------
    axes : names of the d modelled axes; palm and material are level and aligned on the others
    palm, mean : (d,) positions, m (yaw: rad)
    material_pose : x, y, z (m), roll, pitch, yaw (rad) of N in the reference frame
    """
    at, believed = (dict(zip(axes, values.tolist(), strict=True)) for values in (palm, mean))
    turn = Rotation.from_euler("z", at.get("yaw", 0.0) - believed.get("yaw", 0.0))
    places = [np.array([place.get("x", 0.0), place.get("y", 0.0), 0.0]) for place in (at, believed)]
    nominal = Rotation.from_euler("xyz", material_pose[3:])
    translation = np.asarray(material_pose[:3]) + nominal.apply(places[0] - turn.apply(places[1]))
    return translation, (nominal * turn).as_quat()


def _pose(transform: TransformStamped) -> PoseStamped:
    message = PoseStamped(header=transform.header)
    place = transform.transform.translation
    message.pose.position.x, message.pose.position.y, message.pose.position.z = place.x, place.y, place.z
    message.pose.orientation = transform.transform.rotation
    return message


def _imported(module: str, parameter: str) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError:
        raise ParameterError(
            f"{parameter}: expected {module.partition('.')[0]} to be installed, found none"
        ) from None
