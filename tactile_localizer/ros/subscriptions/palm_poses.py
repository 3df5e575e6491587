"""Subscriptions to palm poses: on a topic, or in tf."""

from __future__ import annotations

from collections.abc import Callable

from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile

from tactile_localizer.errors import MeasurementError, ParameterError
from tactile_localizer.ros.base.parameters import Parameters
from tactile_localizer.ros.subscriptions.draining import Topic
from tactile_localizer.ros.subscriptions.tf_poses import PalmLookup


def lookup(
    parameters: Parameters,
    found: Callable[[PoseStamped], None],
    missed: Callable[[MeasurementError], None],
) -> PalmLookup | None:
    """What looks up palm poses in tf and hands them over; ``None`` where they arrive on a topic.

    Raises
    ------
    ParameterError
        tf2_ros is not installed, or there is no ``reference_frame`` to look the palm up in.
    """
    if parameters["pose_source"] == "topic":
        return None
    if not parameters["reference_frame"]:
        raise ParameterError("reference_frame: expected a frame to look palm_frame up in, got none")
    frames = parameters["reference_frame"], parameters["palm_frame"]
    return PalmLookup(*frames, parameters["patience_s"], found, missed)


def pose_topics(lookup: PalmLookup | None, on_pose: Callable[[PoseStamped], None]) -> list[Topic]:
    """What a node subscribes to for palm poses."""
    if lookup is not None:
        return lookup.topics()
    return [Topic(PoseStamped, "palm_pose", on_pose, QoSProfile(depth=100))]
