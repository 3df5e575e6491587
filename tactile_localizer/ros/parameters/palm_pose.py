"""Parameters of palm poses and their frames, for the filter and the mapping node."""

from __future__ import annotations

from tactile_localizer.ros.base.parameters import Parameter

PARAMETERS = (
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
