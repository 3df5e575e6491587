"""Palm poses from messages, in the frames that the parameters allow."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile

from tactile_localizer.core.geometry.palm_frame import PalmFrame
from tactile_localizer.errors import MeasurementError, ParameterError
from tactile_localizer.nodes.hearing import Topic
from tactile_localizer.nodes.parameters import Parameter, Parameters
from tactile_localizer.nodes.transforms import PalmLookup
from tactile_localizer.scene import Scene

PARAMETERS = (
    Parameter(
        "pose_source",
        "topic",
        "Palm poses arrive on palm_pose (topic), or are looked up in tf at the strain's stamp",
        choices=("topic", "tf"),
    ),
    Parameter("palm_frame", "palm", "Frame that is looked up in reference_frame where pose_source is tf"),
    Parameter("material_frame", "material", "Frame in which palm poses are taken as they are"),
    Parameter(
        "reference_frame",
        "base_link",
        "Frame from which palm poses are brought into the material's by material_pose; empty: none",
    ),
    Parameter(
        "material_pose",
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        "Where the material is in reference_frame: x, y, z, roll, pitch, yaw",
        "m, rad",
    ),
)


def palm_frame(parameters: Parameters, scene: Scene) -> PalmFrame:
    """What the parameters say about frames.

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
        The pose is in a frame that cannot be used, or is not finite.
    """
    place, turn = message.pose.position, message.pose.orientation
    return frame.position(
        message.header.frame_id, (place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w)
    )


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
