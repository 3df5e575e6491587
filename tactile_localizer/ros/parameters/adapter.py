"""Parameters of the adapter node."""

from __future__ import annotations

from tactile_localizer.ros.base.parameters import Parameter

PARAMETERS = (
    Parameter("adapter_file", "wrench.yaml", "Which messages are strain: a YAML file, or a shipped one"),
    Parameter("frame_id", "palm", "Frame in the header of the strain vectors"),
)
