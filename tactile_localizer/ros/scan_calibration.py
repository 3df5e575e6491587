"""Calibration of a scan in the background when its recording pauses, kept in its folder."""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scans.learned import learned_calibration
from tactile_localizer.io.scans.recorder import SweepRecorder
from tactile_localizer.ros.base.background import BackgroundJob
from tactile_localizer.ros.diagnostics.status import DiagnosticsPublisher, ProgressReporter

QUIET_S = 5.0
"""Time without an active sweep after which a scan is calibrated, s: longer than the pause between sweeps."""


class ScanCalibration:
    """Calibrates a scan whenever no sweep has been active for :data:`QUIET_S`.

    The filter then starts without calibrating. If recording continues, the calibration is repeated in the
    next pause.

    Parameters
    ----------
    node : node that records
    recorder : recorder of the scan
    publisher : publisher of the progress
    """

    def __init__(self, node: Node, recorder: SweepRecorder, publisher: DiagnosticsPublisher) -> None:
        self._recorder, self._publisher = recorder, publisher
        self._job = BackgroundJob(node, "calibration")
        self._progress = ProgressReporter(node, publisher, "calibration")
        self._log = node.get_logger()
        self._quiet_since_s = time.monotonic()
        self._attempted_pairs = 0
        self._is_closed = False
        self._level, self._message = DiagnosticStatus.OK, "not calibrated: scan in progress"

    def close(self) -> None:
        """Stop a calibration in progress at its next step."""
        self._is_closed = True

    def poll(self) -> None:
        """Start a calibration if one is due, and publish the status."""
        pairs, now_s = self._recorder.pairs, time.monotonic()
        if self._recorder.is_active or self._recorder.store.active_sweep is not None:
            self._quiet_since_s = now_s
        is_quiet = now_s - self._quiet_since_s >= QUIET_S
        if is_quiet and pairs != self._attempted_pairs and not self._job.is_running:
            self._attempted_pairs = pairs
            self._job.start(self._calibrate, self._on_result, self._on_error)
        if not self._job.is_running:
            self._publisher.publish(
                self._publisher.status("calibration", self._level, self._message, {"pairs": pairs})
            )

    def _calibrate(self) -> None:
        folder = ScanFolder(self._recorder.store.path)
        learned_calibration(folder.path, folder.load(), folder.scene, self._report)

    def _report(self, doing: str, done: float) -> None:
        if self._is_closed:
            raise InterruptedError("the node was shut down")
        self._progress(doing, done)

    def _on_result(self, _: None) -> None:
        if not self._is_closed:
            self._log.info(f"{self._recorder.store.path}: calibrated")
            self._level, self._message = DiagnosticStatus.OK, "calibrated"

    def _on_error(self, reason: str) -> None:
        if not self._is_closed:
            self._level, self._message = DiagnosticStatus.WARN, f"not calibrated: {reason}"
