"""Palm positions from pose messages, in the frames given by the parameters."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import PoseStamped

from tactile_localizer.core.geometry.palm_frame import PalmFrame
from tactile_localizer.ros.base.parameters import Parameters
from tactile_localizer.scene import Scene


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
