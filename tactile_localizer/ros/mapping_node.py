"""Records a training scan: by sweeps, strain vectors and the palm positions at their stamps."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rclpy.clock import Clock, ClockType
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

from tactile_localizer.core.geometry.synchronization import Pair, Pairing
from tactile_localizer.core.scan.coverage import Coverage
from tactile_localizer.core.scan.sweep_detector import SweepDetector
from tactile_localizer.errors import MeasurementError, ParameterError, ScanError, TactileLocalizerError
from tactile_localizer.io.scans.recorder import StrainSample, SweepRecorder
from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.msg import ScanStatus, StrainVectors
from tactile_localizer.resources import given_or_shipped
from tactile_localizer.ros.base.executable import run
from tactile_localizer.ros.base.managed_node import ManagedNode
from tactile_localizer.ros.conversions import timestamps
from tactile_localizer.ros.conversions.palm_poses import palm_frame, position
from tactile_localizer.ros.conversions.strain_vectors import StrainReader
from tactile_localizer.ros.diagnostics.mapping import MappingDiagnostics
from tactile_localizer.ros.parameters.mapping import PARAMETERS
from tactile_localizer.ros.publishers.maps import RecordedMap
from tactile_localizer.ros.subscriptions import palm_poses
from tactile_localizer.ros.subscriptions.draining import Topic, hear
from tactile_localizer.ros.subscriptions.sender_clock import SendersClock

_COMMIT_PERIOD_S = 0.2
_STATUS_PERIOD_S = 0.5
_DIAGNOSTICS_PERIOD_S = 1.0


class MappingNode(ManagedNode):
    """Pairs ``strain`` with ``palm_pose`` by stamps and appends the pairs of each sweep to the scan file."""

    def __init__(self) -> None:
        super().__init__("mapping", PARAMETERS)
        self._recorder: SweepRecorder | None = None
        self._pairing: Pairing[StrainSample] | None = None
        self._status: Any = None
        self._health: Any = None
        self._map: RecordedMap | None = None
        self._made: list[tuple[Callable[[Any], Any], Any]] = []

    def configure(self) -> None:
        """Open the scan file and offer the status."""
        of = self.parameters
        for name in ("scan_file", "scene_file"):
            if not of[name]:
                raise ParameterError(f"{name}: expected a path, got none")
        self._scene = load_scene(given_or_shipped(of["scene_file"], "config/scenes"))
        self._frame = palm_frame(of, self._scene)
        self._lookup = palm_poses.lookup(of, self._on_pose, partial(self._refuse, "palm_pose"))
        self._reader = StrainReader(self._scene)
        self._coverage = Coverage(self._scene, of["sweep_distance_m"])
        store = ScanStore.open_or_create(of["scan_file"], self._scene)
        self._recorder = SweepRecorder(store, self._detector(), self._coverage, self._publish_status)
        for _, _, states, _ in store.batches():
            self._coverage.add(states)
        store.note("record", {"node": self.get_fully_qualified_name()})
        latched = QoSProfile(
            depth=10, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
        )
        self._status = self.create_lifecycle_publisher(ScanStatus, "~/status", latched)
        self._health = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._diagnostics = MappingDiagnostics(self.get_fully_qualified_name().lstrip("/"))
        self._map = RecordedMap(self, store.path, of["material_frame"])

    def activate(self) -> None:
        """Listen to strain and poses, offer the services, and publish the status."""
        of = self.parameters
        self._pairing = Pairing(self._scene.axes, max_gap_s=of["max_gap_s"], patience_s=of["patience_s"])
        self._clock_of_stamps = SendersClock()
        self._rate = 0.0
        self._last_sweep: int | None = None
        self._refusals: dict[str, str] = {}
        self._poses = 0
        self._failure = ""
        self._counts: deque[tuple[float, int]] = deque(maxlen=3)
        best_effort = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
        heard = (
            Topic(StrainVectors, "strain", self._on_strain, best_effort),
            *palm_poses.pose_topics(self._lookup, self._on_pose),
        )
        self._made = [(self.destroy_subscription, one) for one in hear(self, heard)]
        for name, answer in (("~/start_sweep", self._on_start), ("~/end_sweep", self._on_end)):
            self._made.append((self.destroy_service, self.create_service(Trigger, name, answer)))
        # Time that cannot be set back or stand still, whatever the nodes' clock does.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        for period_s, tick in (
            (_COMMIT_PERIOD_S, self._commit),
            (_STATUS_PERIOD_S, self._on_status_due),
            (_DIAGNOSTICS_PERIOD_S, self._on_diagnostics_due),
        ):
            self._made.append((self.destroy_timer, self.create_timer(period_s, tick, clock=steady)))
        self._publish_status(self._newest_ns)
        if self._map is not None:
            self._map.refresh()

    def deactivate(self) -> None:
        """End the sweep and stop listening."""
        for destroy, made in self._made:
            destroy(made)
        self._made = []
        if self._recorder is not None and self._pairing is not None:
            self._record(self._pairing.finish())
            self._attempt_to(self._recorder.close)
            self._pairing = None

    def cleanup(self) -> None:
        """Close the scan file."""
        if self._map is not None:
            self._map.close()
            self._map = None
        if self._recorder is not None:
            recorder, self._recorder = self._recorder, None
            self._attempt_to(recorder.store.close)
        if self._status is not None:
            self.destroy_lifecycle_publisher(self._status)
        if self._health is not None:
            self.destroy_publisher(self._health)
        self._status = self._health = None

    def _detector(self) -> SweepDetector | None:
        of = self.parameters
        if of["sweep_detection"] == "off":
            return None
        return SweepDetector(
            self._scene.axes,
            one_way=of["sweep_detection"] == "one_way",
            reversal_m=of["reversal_m"],
            rest_s=of["rest_s"],
        )

    def _on_strain(self, message: StrainVectors) -> None:
        stamp_ns = timestamps.to_ns(message.header.stamp)
        if self._pairing is None or not stamp_ns:
            return
        self._hear(stamp_ns, self._pairing)
        try:
            felt = self._reader.read(message)
        except TactileLocalizerError as error:
            self._refuse("strain", error)
            return
        self._refusals.pop("strain", None)
        self._record(self._pairing.add_strain(stamp_ns, felt))
        if self._lookup is not None:
            self._lookup.look_up(stamp_ns)

    def _on_pose(self, message: PoseStamped) -> None:
        stamp_ns = timestamps.to_ns(message.header.stamp)
        if self._pairing is None or not stamp_ns:
            return
        self._hear(stamp_ns, self._pairing)
        try:
            pairs = self._pairing.add_pose(stamp_ns, position(self._frame, message))
        except MeasurementError as error:
            self._refuse("palm_pose", error)
            return
        self._refusals.pop("palm_pose", None)
        self._poses += 1
        self._record(pairs)

    def _hear(self, stamp_ns: int, pairing: Pairing[StrainSample]) -> None:
        self._clock_of_stamps.hear(stamp_ns, self.get_clock().now().nanoseconds, pairing.resets)

    def _refuse(self, topic: str, error: TactileLocalizerError) -> None:
        """A message cannot be used: no sweep begins until the next of its topic can."""
        self._refusals[topic] = f"{topic}: {error}"
        self._complain(self._refusals[topic])

    def _record(self, pairs: list[Pair[StrainSample]]) -> None:
        if self._recorder is not None:
            self._attempt_to(self._recorder.take, pairs)

    def _commit(self) -> None:
        if self._recorder is None or self._pairing is None:
            return
        self._attempt_to(self._recorder.settle, self._pairing.waiting_ns)
        before, self._last_sweep = self._last_sweep, self._recorder.store.active_sweep
        if before is not None and before != self._last_sweep and self._map is not None:
            self._map.refresh()

    def _on_start(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Begin a sweep with what is felt from now on."""

        def start(recorder: SweepRecorder) -> str:
            for reason in self._refusals.values():
                raise ScanError(f"start sweep: {reason}")
            number = recorder.start(self._now_ns)
            self._failure = ""
            return f"sweep {number} begins"

        return self._answer(response, start)

    def _on_end(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """End the sweep after the newest sample that has come."""
        return self._answer(response, lambda recorder: f"sweep {recorder.end(self._newest_ns)} ends")

    def _answer(self, response: Trigger.Response, work: Callable[[SweepRecorder], str]) -> Trigger.Response:
        try:
            if self.parameters["sweep_detection"] != "off":
                raise ScanError("sweeps are found from the motion: expected sweep_detection off")
            if self._recorder is None:
                raise ScanError("expected an active node")
            response.message = work(self._recorder)
            response.success = True
            self.get_logger().info(response.message)
        except ScanError as error:
            response.message = str(error)
            self.get_logger().error(response.message)
        return response

    def _on_status_due(self) -> None:
        if self._recorder is not None:
            self._counts.append((time.monotonic(), self._recorder.store.pairs))
            (first_s, first), (last_s, last) = self._counts[0], self._counts[-1]
            self._rate = (last - first) / max(last_s - first_s, _STATUS_PERIOD_S)
        self._publish_status(self._newest_ns)

    def _on_diagnostics_due(self) -> None:
        if self._recorder is None or self._pairing is None:
            return
        message = DiagnosticArray()
        message.header.stamp = self.get_clock().now().to_msg()
        message.status = [
            self._diagnostics.status(
                self._recorder, self._pairing, self._poses, self._refusals, self._failure
            )
        ]
        self._health.publish(message)

    @property
    def _newest_ns(self) -> int:
        """Stamp of the newest sample, ns; 0 before the first."""
        return (self._pairing and self._pairing.newest_ns) or 0

    @property
    def _now_ns(self) -> int:
        """Stamp of what is felt now, ns: what was felt before may come after a request, on a busy machine."""
        return self._clock_of_stamps.now_ns(self.get_clock().now().nanoseconds)

    def _publish_status(self, stamp_ns: int) -> None:
        """Tell how the scan is going; stamps are samples', so that a bag shows what belongs to a sweep."""
        recorder = self._recorder
        if recorder is None or not self.context.ok():
            return
        message = ScanStatus()
        message.header.stamp = timestamps.from_ns(max(stamp_ns, 0))
        message.header.frame_id = self.parameters["material_frame"]
        message.scan_file = str(recorder.store.path)
        message.scene = self._scene.name
        message.sweep_active = recorder.is_active
        message.sweep = recorder.number
        message.sweeps = recorder.sweeps
        message.samples = recorder.store.pairs
        message.coverage = self._coverage.share
        message.gaps = recorder.gaps
        message.skipped = recorder.skipped
        message.rate = self._rate
        self._status.publish(message)

    def _attempt_to(self, work: Callable[..., None], *arguments: Any) -> None:
        """Do what may fail for want of disk space; the node says so and goes on."""
        try:
            work(*arguments)
        except ScanError as error:
            self._failure = str(error)
            self._complain(self._failure)
            self._publish_status(self._newest_ns)

    def _complain(self, text: str) -> None:
        self.get_logger().error(text, throttle_duration_sec=1.0)


def main() -> int:
    """Run the node."""
    return run(MappingNode)
