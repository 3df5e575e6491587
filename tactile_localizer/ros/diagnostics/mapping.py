"""What the mapping node tells about itself once a second: whether it records, and what it loses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from tactile_localizer.core.geometry.synchronization import Pairing
from tactile_localizer.io.scans.recorder import StrainSample, SweepRecorder


class MappingDiagnostics:
    """Makes the diagnostics of a mapping node; warns of what was lost since the last call.

    Parameters
    ----------
    name : of the node, before the status's own name
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._lost: dict[str, int] = {}
        self._pairs = 0

    def status(
        self,
        recorder: SweepRecorder,
        pairing: Pairing[StrainSample],
        poses: int,
        refusals: Mapping[str, str],
        failure: str,
    ) -> Any:
        """The state of the recording.

        Parameters
        ----------
        recorder, pairing : what is told about
        poses : palm poses heard that can be used
        refusals : by topic, why its messages cannot be used
        failure : why the file could not be written at last; empty when it could
        """
        lost = {
            "samples without a pose": recorder.gaps,
            "samples missing, saturated or out of bounds": recorder.skipped,
            "messages that came late": pairing.late,
            "times that stamps went back": pairing.resets,
        }
        new = {what: count - self._lost.get(what, 0) for what, count in lost.items()}
        self._lost = lost
        found = [f"{count} {what}" for what, count in new.items() if count > 0]
        if recorder.is_active and recorder.store.pairs == self._pairs and not found:
            found = ["nothing comes"]
        self._pairs = recorder.store.pairs
        told = ", ".join(found)
        trouble = "; ".join(filter(None, [failure, *refusals.values()]))
        doing = f"recording sweep {recorder.number}" if recorder.is_active else "no sweep under way"
        level = DiagnosticStatus.OK
        if trouble or told:
            level = DiagnosticStatus.ERROR if trouble else DiagnosticStatus.WARN
        values: dict[str, Any] = {
            "scan_file": recorder.store.path,
            "pairs": recorder.store.pairs,
            "sweeps": recorder.sweeps,
            "gaps": recorder.gaps,
            "skipped": recorder.skipped,
            "late": pairing.late,
            "poses": poses,
            "time_jumps": pairing.resets,
        }
        return DiagnosticStatus(
            level=level,
            name=f"{self._name}: scan",
            message=": ".join(filter(None, [doing, trouble or told])),
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
