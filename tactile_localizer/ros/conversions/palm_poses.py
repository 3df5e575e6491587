"""Palm poses from messages, in the frames that the parameters allow."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import PoseStamped

from tactile_localizer.core.geometry.palm_frame import PalmFrame
from tactile_localizer.ros.base.parameters import Parameters
from tactile_localizer.scene import Scene


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
