"""Diagnostics of the mapping node: state of the recording, losses, and calibration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from tactile_localizer.core.geometry.synchronization import Pairing
from tactile_localizer.io.scans.recorder import StrainSample, SweepRecorder
from tactile_localizer.ros.diagnostics.status import DiagnosticsPublisher, Increments


class MappingDiagnostics:
    """Makes the status of a recording; losses since the previous status are a warning.

    Parameters
    ----------
    publisher : publisher of the status
    """

    def __init__(self, publisher: DiagnosticsPublisher) -> None:
        self._publisher = publisher
        self._losses = Increments()
        self._pairs = 0

    def status(
        self,
        recorder: SweepRecorder,
        pairing: Pairing[StrainSample],
        poses: int,
        rejections: Mapping[str, str],
        write_error: str,
    ) -> DiagnosticStatus:
        """The state of the recording.

        Parameters
        ----------
        recorder, pairing : recording to describe
        poses : number of valid palm poses received
        rejections : by topic, why its last message was rejected
        write_error : why the scan could not be written; empty if it could
        """
        losses = self._losses.describe(
            {
                "samples without a pose": recorder.gaps,
                "samples missing, saturated or out of bounds": recorder.skipped,
                "late messages": pairing.late,
                "backward jumps of the stamps": pairing.resets,
            }
        )
        if recorder.is_active and recorder.pairs == self._pairs and not losses:
            losses = ["no samples received"]
        self._pairs = recorder.pairs
        errors = "; ".join(filter(None, [write_error, *rejections.values()]))
        warnings = ", ".join(losses)
        activity = f"recording sweep {recorder.number}" if recorder.is_active else "no active sweep"
        level = DiagnosticStatus.OK
        if errors or warnings:
            level = DiagnosticStatus.ERROR if errors else DiagnosticStatus.WARN
        values: dict[str, Any] = {
            "scan_file": recorder.store.path,
            "pairs": recorder.pairs,
            "sweeps": recorder.sweeps,
            "gaps": recorder.gaps,
            "skipped": recorder.skipped,
            "late": pairing.late,
            "poses": poses,
            "backward_jumps": pairing.resets,
        }
        message = ": ".join(filter(None, [activity, errors or warnings]))
        return self._publisher.status("scan", level, message, values)
