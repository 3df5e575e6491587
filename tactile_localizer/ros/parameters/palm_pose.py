"""Parameters of palm poses, for the filter and the mapping node."""

from __future__ import annotations

from tactile_localizer.core.geometry.pose_buffer import DEFAULT_MAX_GAP_S
from tactile_localizer.core.geometry.synchronization import DEFAULT_PATIENCE_S
from tactile_localizer.ros.base.parameters import Parameter

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
