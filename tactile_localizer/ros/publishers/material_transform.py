"""The pose of the material, published to tf while the estimate has converged."""

import math
from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from rclpy.lifecycle import LifecycleNodeMixin

from tactile_localizer.core.localizer import Estimate
from tactile_localizer.errors import ParameterError
from tactile_localizer.ros.base.parameters import import_optional
from tactile_localizer.ros.conversions import from_ns

PUBLISH_PERIOD_NS = 20_000_000
"""Minimum interval between transforms, ns: 50 Hz suffice for planners and RViz."""


class MaterialBroadcaster:
    """Publishes the transform from ``reference_frame`` to ``material_frame`` of converged estimates.

    On unmodelled axes it is that of ``material_pose``.

    Parameters
    ----------
    node : node that publishes while it is active
    reference_frame, material_frame : parent and child frame
    material_pose : nominal x, y, z (m), roll, pitch, yaw (rad) of the material, used to transform palm poses

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
                f"publish_tf: expected a reference_frame other than material_frame, got {reference_frame!r}"
            )
        self._message = import_optional("tf2_msgs.msg", "publish_tf").TFMessage
        self._frames, self._material_pose = (reference_frame, material_frame), material_pose
        self._published_ns = -math.inf
        self._publisher = node.create_lifecycle_publisher(self._message, "/tf", 100)

    def publish(self, estimate: Estimate, axes: tuple[str, ...], palm: np.ndarray) -> None:
        """Publish the transform of a converged estimate, at the maximum rate.

        Parameters
        ----------
        estimate : estimated position of the palm on the material; ignored unless converged
        axes : names of its axes
        palm : (d,) palm position that the estimate was made with, in the nominal material frame, m (yaw: rad)
        """
        if not estimate.converged or 0 <= estimate.stamp_ns - self._published_ns < PUBLISH_PERIOD_NS:
            return
        self._published_ns = estimate.stamp_ns
        translation, quaternion = material_in_reference(axes, palm, estimate.mean, self._material_pose)
        transform = TransformStamped(child_frame_id=self._frames[1])
        transform.header.frame_id, transform.header.stamp = self._frames[0], from_ns(estimate.stamp_ns)
        transform.transform.translation = Vector3(**dict(zip("xyz", translation.tolist(), strict=True)))
        transform.transform.rotation = Quaternion(**dict(zip("xyzw", quaternion.tolist(), strict=True)))
        self._publisher.publish(self._message(transforms=[transform]))


def material_in_reference(
    axes: tuple[str, ...], palm: np.ndarray, mean: np.ndarray, material_pose: Sequence[float]
) -> tuple[np.ndarray, np.ndarray]:
    """Pose of the material in the reference frame: translation (3,), m, and quaternion (4,), x y z w.

    With the palm at ``palm`` in the nominal material frame N and at ``mean`` on the material M,
    ``T_reference_M = T_reference_N T_N_palm inv(T_M_palm)``.

    Parameters
    ----------
    axes : names of the d modelled axes; on the others palm and material are aligned
    palm, mean : (d,) positions, m (yaw: rad)
    material_pose : x, y, z (m), roll, pitch, yaw (rad) of N in the reference frame
    """
    from scipy.spatial.transform import Rotation

    at_palm, at_mean = (dict(zip(axes, values.tolist(), strict=True)) for values in (palm, mean))
    rotation = Rotation.from_euler("z", at_palm.get("yaw", 0.0) - at_mean.get("yaw", 0.0))
    points = [np.array([point.get("x", 0.0), point.get("y", 0.0), 0.0]) for point in (at_palm, at_mean)]
    nominal = Rotation.from_euler("xyz", material_pose[3:])
    translation = np.asarray(material_pose[:3]) + nominal.apply(points[0] - rotation.apply(points[1]))
    return translation, (nominal * rotation).as_quat()
