"""Mapping node: records a training scan, sweeps of strain vectors with the palm positions at their stamps.

Publishes ``~/status`` and ``~/map`` (latched) and ``/diagnostics`` at 1 Hz. ``~/start_sweep`` and
``~/end_sweep`` delimit the sweeps, unless they are detected from the motion. When the node is deactivated,
the scan examines itself, and the log says what it is good for.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future
from std_srvs.srv import Trigger

from tactile_localizer.core.calibration.examination import Examination
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.errors import ParameterError, ScanError, TactileLocalizerError, counted
from tactile_localizer.io.scans.folder import SESSIONS, STRAIN_DELAY, ScanFolder
from tactile_localizer.io.scans.learned import Reading, learn_and_keep
from tactile_localizer.io.scans.recorder import StrainSample, SweepRecorder
from tactile_localizer.io.scans.sweep_files import OpenSweep
from tactile_localizer.io.scans.writer import ScanWriter
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.msg import ScanStatus
from tactile_localizer.offline.examination import describe_examination, examination_findings
from tactile_localizer.resources import given_or_shipped
from tactile_localizer.ros.base.background import run_in_thread
from tactile_localizer.ros.base.executable import run
from tactile_localizer.ros.base.managed_node import ManagedNode
from tactile_localizer.ros.base.parameters import Parameter
from tactile_localizer.ros.conversions import from_ns
from tactile_localizer.ros.diagnostics.status import DiagnosticsPublisher, Increments
from tactile_localizer.ros.publishers.maps import MapPublisher
from tactile_localizer.ros.subscriptions.tactile_inputs import FRAMES, INPUTS, SYNCHRONIZATION, TactileInputs
from tactile_localizer.streams.coverage import SWEEP_DISTANCE_M, Coverage
from tactile_localizer.streams.findings import CLOCKS, MOTION
from tactile_localizer.streams.runs import NANOSECONDS
from tactile_localizer.streams.session import Pair
from tactile_localizer.streams.sweep_detector import (
    DEFAULT_REST_S,
    DEFAULT_REVERSAL_M,
    NO_SWEEP,
    SweepDetector,
)

PARAMETERS = (
    Parameter("scan_file", "", "Scan (folder) to record to; an existing one is continued", at_start=True),
    Parameter("scene_file", "", "Scene (YAML) of the recording: path or shipped file name", at_start=True),
    *SYNCHRONIZATION,
    Parameter(
        "sweep_detection",
        "off",
        "Detection of sweeps from the motion; off: services delimit them, one_way: without return motions",
        choices=("off", "both_ways", "one_way"),
    ),
    Parameter("reversal_m", DEFAULT_REVERSAL_M, "Backward travel that ends a sweep", "m", 1e-5, 1.0),
    Parameter("rest_s", DEFAULT_REST_S, "Time at rest that ends a sweep", "s", 0.1, 60.0),
    Parameter(
        "sweep_distance_m",
        SWEEP_DISTANCE_M,
        "Distance between neighbouring sweeps, for the coverage",
        "m",
        1e-5,
        1.0,
    ),
    *FRAMES,
)

_STATUS_QOS = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_COMMIT_PERIOD_S = 0.2
_STATUS_PERIOD_S = 0.2
_STILL_NS = 3 * NANOSECONDS
"""Time from the begin of a sweep after which a palm that rests is reported, ns."""


class Ending(NamedTuple):
    """A sweep that ends, until all of it is written or a monotonic time is reached."""

    sweep: OpenSweep
    until_ns: int
    deadline_s: float
    written: Future


class MappingNode(ManagedNode):
    """Pairs ``strain`` with ``palm_pose`` by stamps and records the pairs of each sweep."""

    def __init__(self) -> None:
        super().__init__("tactile_mapping", PARAMETERS)

    def configure(self) -> None:
        """Open the scan and create the publishers."""
        parameters = self.parameters
        for name in ("scan_file", "scene_file"):
            if not parameters[name]:
                raise ParameterError(f"{name}: expected a path, got none")
        self._scene = load_scene(given_or_shipped(parameters["scene_file"], "config/scenes"))
        self._inputs = TactileInputs(self, self._record)
        self._coverage = Coverage(self._scene, parameters["sweep_distance_m"])
        store = ScanWriter(parameters["scan_file"], self._scene)
        self.defer(store.close)
        self._detector = self._new_detector()
        detects = self._detector is not None
        self._recorder = SweepRecorder(store, detects, self._coverage, self._publish_status)
        delay = {STRAIN_DELAY: parameters["strain_delay_s"]} if parameters["strain_delay_s"] else {}
        sessions = {SESSIONS: [store.last_number + 1]}
        store.note("record", node=self.get_fully_qualified_name(), **sessions, **delay)
        self._status = self.create_lifecycle_publisher(ScanStatus, "~/status", _STATUS_QOS)
        self._health = DiagnosticsPublisher(self)
        self._map = MapPublisher(self, parameters["material_frame"])

    def activate(self) -> None:
        """Subscribe to strain and poses; create the services and timers."""
        self._inputs.start(self._scene, self._detector)
        self.defer(self._end_recording)
        self._rate = 0.0
        self._last_sweep: int | None = None
        self._losses, self._pairs, self._arrivals = Increments(), Increments(), Increments()
        self._is_absent = False
        self._write_error = ""
        self._ending: list[Ending] = []
        self._changed = 0, 0
        self._inputs.subscribe()
        self.defer(self._inputs.take_waiting)
        self.create_service(Trigger, "~/start_sweep", self._on_start)
        alone = MutuallyExclusiveCallbackGroup()  # messages arrive while it waits for them
        self.create_service(Trigger, "~/end_sweep", self._on_end, callback_group=alone)
        self.create_timer(_COMMIT_PERIOD_S, self._commit)
        self.create_timer(_STATUS_PERIOD_S, self._publish_status)
        self._health.publish_each_second(self._statuses)
        self._publish_status()
        self._refresh_map()

    def _end_recording(self) -> None:
        self._record(self._inputs.session.finish())
        self._try_to_write(self._recorder.close)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition to inactive, the end of a session: the scan is examined in the background."""
        result = super().on_deactivate(state)
        if self._recorder.pairs and self.executor is not None:
            self.executor.create_task(self._examine(Path(self._recorder.store.path)))
        return result

    async def _examine(self, path: Path) -> None:
        """Examine a scan, for the next start of the filter too, and log what it shows."""

        def examine() -> Examination:
            reading = Reading.of(ScanFolder(path))
            return learn_and_keep(reading, self._scene, Configuration(), self._log_progress)[0].examination

        try:
            examination = await run_in_thread(self, examine)
        except TactileLocalizerError as error:
            self.get_logger().error(f"examination: {error}")
            return
        for line in describe_examination(self._scene, examination):
            self.get_logger().info(line)
        for line in examination_findings(self._scene, examination):
            self.get_logger().warning(line)

    def _log_progress(self, activity: str, fraction: float) -> None:
        self.get_logger().info(f"{activity}: {fraction:.0%}")

    def _refresh_map(self) -> None:
        """Publish the map of the sweeps so far."""
        if self._recorder.pairs:
            self._map.publish_folder(self._recorder.store.path)

    def _new_detector(self) -> SweepDetector | None:
        parameters = self.parameters
        if parameters["sweep_detection"] == "off":
            return None
        return SweepDetector(
            self._scene.axes,
            one_way=parameters["sweep_detection"] == "one_way",
            reversal_m=parameters["reversal_m"],
            rest_s=parameters["rest_s"],
        )

    def _record(self, pairs: list[Pair[StrainSample]]) -> None:
        self._try_to_write(self._recorder.take, pairs)
        self._answer_endings()

    def _commit(self) -> None:
        self._try_to_write(self._recorder.settle, self._inputs.session.settled)
        self._answer_endings()
        for ending in [each for each in self._ending if time.monotonic() > each.deadline_s]:
            self._inputs.take_waiting()
            self._try_to_write(self._recorder.take, self._inputs.session.finish(ending.until_ns))
            self._try_to_write(self._recorder.settle)
            self._answer_endings(max(ending.until_ns - self._inputs.newest_ns, 0) / NANOSECONDS)
        previous, self._last_sweep = self._last_sweep, self._recorder.incomplete
        if previous is not None and previous != self._last_sweep:
            self._refresh_map()

    def _answer_endings(self, missing_s: float = 0.0) -> None:
        """Answer the requests for the end of sweeps that are complete, but for their last ``missing_s``."""
        for ending in [each for each in self._ending if self._recorder.is_complete(each.sweep)]:
            self._ending.remove(ending)
            ending.written.set_result(missing_s)

    def _on_start(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Start a sweep with the strain measured from now on, unless the last messages were invalid."""
        self._require_requests()
        after_ns = self._inputs.present_ns()
        for reason in self._inputs.problems.values():
            raise ScanError(f"start sweep: {reason}")
        session = self._inputs.session
        number = self._recorder.start(session.run, after_ns)
        session.mark(session.run, after_ns, number)
        response.message = f"sweep {number} started"
        response.success = True
        self._write_error = ""
        self.get_logger().info(response.message)
        return response

    async def _on_end(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """End the sweep with the strain measured until now; answer when all of it is written."""
        self._require_requests()
        until_ns = self._inputs.present_ns()
        self._require_written()
        session = self._inputs.session
        sweep = self._recorder.end(session.run, until_ns)
        session.mark(session.run, until_ns, NO_SWEEP)
        written: Future = Future(executor=self.executor)
        written.add_done_callback(lambda done: None)  # wakes the executor
        deadline_s = time.monotonic() + self.parameters["patience_s"] + 2 * _COMMIT_PERIOD_S
        self._ending.append(Ending(sweep, until_ns, deadline_s, written))
        missing_s = await written
        self._require_written()
        said = [f"sweep {sweep.number} ended: {counted(sweep.pairs, 'pair') if sweep.pairs else 'no pairs'}"]
        said += [f"{counted(sweep.gaps, 'sample')} without a pose"] if sweep.gaps else []
        said += [f"{sweep.skipped} missing, saturated or out of bounds"] if sweep.skipped else []
        said += [f"no strain for its last {missing_s:.1f} s"] if missing_s else []
        response.message = ", ".join(said)
        response.success = sweep.pairs > 0
        log = self.get_logger()
        (log.info if response.success else log.error)(response.message)
        return response

    def _require_written(self) -> None:
        """Require that the sweep could be written."""
        if self._write_error:
            raise ScanError(f"end sweep: {self._write_error}")

    def _require_requests(self) -> None:
        """Require that sweeps are not detected in the motion."""
        if self._detector is not None:
            raise ScanError(f"expected sweep_detection off, found {self.parameters['sweep_detection']}")

    def _statuses(self) -> list[DiagnosticStatus]:
        """The state of the recording; losses since the previous status are a warning."""
        recorder, session = self._recorder, self._inputs.session
        totals = {
            "samples without a pose": recorder.gaps,
            "samples missing, saturated or out of bounds": recorder.skipped,
            "strain vectors lost in transport": self._inputs.lost,
            "late messages": session.late,
            "backward jumps of the stamps": session.resets,
        }
        losses = self._losses.describe(totals)
        new_pairs = self._pairs.since({"pairs": recorder.pairs})["pairs"]
        self._rate = new_pairs / self._pairs.elapsed_s
        arrived = self._arrivals.since(self._inputs.received)
        absent = [self._inputs.absence(topic) for topic in INPUTS if not arrived.get(topic)]
        if absent and not self._is_absent:
            self.get_logger().warning(" and ".join(absent))
        self._is_absent = bool(absent)
        errors = "; ".join(filter(None, [self._write_error, *self._inputs.problems.values(), *absent]))
        misaligned = self._inputs.finding(CLOCKS)
        began_ns = self._recorder.began_ns
        is_late = began_ns is not None and self._inputs.newest_ns - began_ns > _STILL_NS
        motion = self._inputs.finding(MOTION, moves=is_late)
        behind = self._inputs.behind if losses or misaligned else ""
        warnings = ", ".join(filter(None, [self._inputs.mixed(), misaligned, *losses, behind, motion]))
        activity = f"recording sweep {recorder.number}" if recorder.is_active else "no active sweep"
        level = DiagnosticStatus.OK
        if errors or warnings:
            level = DiagnosticStatus.ERROR if errors else DiagnosticStatus.WARN
        values = {
            "scan_file": recorder.store.path,
            "pairs": recorder.pairs,
            "sweeps": recorder.sweeps,
            "poses": self._inputs.received["palm_pose"] - self._inputs.invalid["palm_pose"],
            **totals,
        }
        message = ": ".join(filter(None, [activity, errors or warnings]))
        return [self._health.status("scan", level, message, values)]

    def _publish_status(self, stamp_ns: int | None = None) -> None:
        """Publish the status of the scan with the stamp of a sample, which assigns it to a sweep in a bag.

        ``stamp_ns`` is where a sweep begins or ends; later statuses are not stamped before it.
        """
        recorder, resets = self._recorder, self._inputs.session.resets
        if stamp_ns is not None:
            self._changed = resets, stamp_ns
        earliest_ns = self._changed[1] if self._changed[0] == resets else 0
        message = ScanStatus()
        message.header.stamp = from_ns(max(earliest_ns, self._inputs.newest_ns if stamp_ns is None else 0))
        message.header.frame_id = self.parameters["material_frame"]
        message.scan_file = str(recorder.store.path)
        message.scene = self._scene.name
        message.sweep_active = recorder.is_active
        message.sweep = recorder.number
        message.sweeps = recorder.sweeps
        message.samples = recorder.pairs
        message.coverage = self._coverage.fraction
        message.gaps = recorder.gaps
        message.skipped = recorder.skipped
        message.rate = self._rate
        self._status.publish(message)

    def _try_to_write(self, work: Callable[..., None], *arguments: Any) -> None:
        """Write to the scan; on an error, such as a full disk, log it and continue."""
        try:
            work(*arguments)
        except ScanError as error:
            self._write_error = str(error)
            self.get_logger().error(self._write_error, throttle_duration_sec=1.0)
            self._publish_status()


def main() -> int:
    """Run the node; returns the exit status."""
    return run(MappingNode)
