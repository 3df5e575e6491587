"""Parameters of the filter and the mapping node about palm poses."""

from __future__ import annotations

from tactile_localizer.ros.base.parameters import Parameter

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
