"""The material's pose, published to tf while the estimate has converged."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.lifecycle import LifecycleNodeMixin
from rclpy.qos import QoSProfile
from scipy.spatial.transform import Rotation

from tactile_localizer.core.localizer import Estimate
from tactile_localizer.errors import ParameterError
from tactile_localizer.ros.base.optional_imports import import_optional
from tactile_localizer.ros.conversions.timestamps import from_ns

_TF = QoSProfile(depth=100)

PUBLISH_PERIOD_NS = 20_000_000
"""Least time, by stamps, between two published transforms, ns: planners and RViz want no more than 50 Hz."""


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
        self._message = import_optional("tf2_msgs.msg", "publish_tf").TFMessage
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
