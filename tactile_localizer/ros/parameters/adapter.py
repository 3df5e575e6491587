"""Parameters of the adapter node."""

from __future__ import annotations

from tactile_localizer.ros.base.parameters import Parameter

PARAMETERS = (
    Parameter(
        "adapter_file",
        "wrench.yaml",
        "Message fields that are strain (YAML): path or shipped file name",
    ),
    Parameter("frame_id", "palm", "Frame in the header of the strain vectors"),
)
