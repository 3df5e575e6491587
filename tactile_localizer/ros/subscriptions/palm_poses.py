"""Sources of palm poses: a topic, or tf."""

from __future__ import annotations

from collections.abc import Callable

from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile

from tactile_localizer.errors import MeasurementError, ParameterError
from tactile_localizer.ros.base.parameters import Parameters
from tactile_localizer.ros.subscriptions.draining import Topic
from tactile_localizer.ros.subscriptions.tf_poses import PalmLookup


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
