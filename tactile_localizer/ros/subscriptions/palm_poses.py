"""Sources of palm poses: a topic, or tf."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile

from tactile_localizer.core.geometry.palm_frame import PalmFrame
from tactile_localizer.core.geometry.pose_buffer import DEFAULT_MAX_GAP_S
from tactile_localizer.core.geometry.synchronization import DEFAULT_PATIENCE_S
from tactile_localizer.errors import MeasurementError, ParameterError
from tactile_localizer.ros.base.parameters import Parameter, Parameters
from tactile_localizer.ros.subscriptions.draining import Topic
from tactile_localizer.ros.subscriptions.tf_poses import PalmLookup
from tactile_localizer.scene import Scene

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
)
"""Synchronization of poses with strain vectors."""

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


def tf_lookup(
    parameters: Parameters,
    on_pose: Callable[[PoseStamped], None],
    on_failure: Callable[[MeasurementError], None],
) -> PalmLookup | None:
    """The lookup of palm poses in tf; ``None`` if they arrive on a topic.

    Raises
    ------
    ParameterError
        tf2_ros is not installed, or ``reference_frame`` is empty.
    """
    if parameters["pose_source"] == "topic":
        return None
    if not parameters["reference_frame"]:
        raise ParameterError("reference_frame: expected the target frame of the lookup in tf, got none")
    frames = parameters["reference_frame"], parameters["palm_frame"]
    return PalmLookup(*frames, parameters["patience_s"], on_pose, on_failure)


def pose_topics(lookup: PalmLookup | None, on_pose: Callable[[PoseStamped], None]) -> list[Topic]:
    """The topics to subscribe to for palm poses."""
    if lookup is not None:
        return lookup.topics()
    return [Topic(PoseStamped, "palm_pose", on_pose, QoSProfile(depth=100))]


def palm_frame(parameters: Parameters, scene: Scene) -> PalmFrame:
    """The transformation of palm poses given by the parameters of the frames.

    Raises
    ------
    ParameterError
        ``material_pose`` is not six finite numbers.
    """
    return PalmFrame(
        scene.axes, parameters["material_frame"], parameters["reference_frame"], parameters["material_pose"]
    )


def position(frame: PalmFrame, message: PoseStamped) -> np.ndarray:
    """The palm's position on the scene's axes, (d,), m (yaw: rad).

    Raises
    ------
    MeasurementError
        The pose is in an unknown frame, or not finite.
    """
    point, rotation = message.pose.position, message.pose.orientation
    return frame.position(
        message.header.frame_id, (point.x, point.y, point.z), (rotation.x, rotation.y, rotation.z, rotation.w)
    )
