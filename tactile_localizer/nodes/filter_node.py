"""Filter node: strain vectors and palm poses to a belief about where the palm is on the material.

Publishes ``~/posterior`` for each strain vector, ``~/pose``, ``~/converged`` and ``~/covariance_trace``
beside it, ``~/particles`` and ``~/markers`` at a lower rate, ``~/map`` once (kept for late subscribers) and
``/diagnostics`` at 1 Hz. ``~/initial_pose`` seeds the belief, ``~/reinitialize_global_localization`` spreads
it over the whole scene, ``~/load_scan`` changes the map. Of several scans ``~/feature`` says which one it is.

A position is never made up: when strain or poses stop, the last one is sent again, marked as stale.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from rclpy.clock import Clock, ClockType
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_srvs.srv import Empty

from tactile_localizer.core.assembly import build_identifier, build_localizer, convergence_criteria
from tactile_localizer.core.feature_localizer import FeatureLocalizer
from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.core.pose_buffer import NANOSECONDS
from tactile_localizer.core.scan import Scan
from tactile_localizer.errors import MeasurementError, ParameterError, TactileLocalizerError
from tactile_localizer.io.confinement import confined
from tactile_localizer.io.scan_store import ScanStore
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.msg import StrainVectors
from tactile_localizer.nodes import palm_pose, posterior_messages, stamps
from tactile_localizer.nodes.filter_diagnostics import FilterDiagnostics, Inputs
from tactile_localizer.nodes.filter_outputs import FilterOutputs
from tactile_localizer.nodes.filter_parameters import LIVE, PARAMETERS, configuration
from tactile_localizer.nodes.hearing import Topic, hear
from tactile_localizer.nodes.lifecycle import ManagedNode, run
from tactile_localizer.nodes.map_publisher import MapPublisher
from tactile_localizer.nodes.strain_vectors import StrainReader
from tactile_localizer.nodes.tracker import Tracker
from tactile_localizer.resources import given_or_shipped
from tactile_localizer.scene import Scene
from tactile_localizer.srv import LoadScan

_BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
_WATCH_PERIOD_S = 0.1
_DIAGNOSTICS_PERIOD_S = 1.0


class FilterNode(ManagedNode):
    """Runs a :class:`~tactile_localizer.nodes.tracker.Tracker` on what is heard."""

    def __init__(self) -> None:
        super().__init__("filter", PARAMETERS)
        self._offered: list[Callable[[], Any]] = []  # withdraw what is there while configured
        self._made: list[Callable[[], Any]] = []  # destroy what is there while active
        self.add_post_set_parameters_callback(self._on_set)

    def configure(self) -> None:
        """Load the map, build the localizer, offer the topics."""
        files = self.parameters["candidate_scan_files"] or [self.parameters["scan_file"]]
        if not all(files):
            raise ParameterError("scan_file: expected a path, got none")
        self._load([Path(file).expanduser() for file in files])
        self._outputs = FilterOutputs(self, self.parameters)
        self._map = MapPublisher(self, self.parameters["material_frame"])
        self._health = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._offered = [self._outputs.close, self._map.close, partial(self.destroy_publisher, self._health)]
        self._map.publish(self._scan, self._tracker.localizer.scene)
        self._diagnostics = FilterDiagnostics(self.get_fully_qualified_name().lstrip("/"))

    def activate(self) -> None:
        """Listen; the belief begins anew."""
        self._begin()
        heard = (
            Topic(StrainVectors, "strain", self._on_strain, _BEST_EFFORT),
            Topic(PoseStamped, "palm_pose", self._on_pose, QoSProfile(depth=100)),
            Topic(PoseWithCovarianceStamped, "~/initial_pose", self._on_initial_pose, QoSProfile(depth=10)),
        )
        self._made = [partial(self.destroy_subscription, one) for one in hear(self, heard)]
        for kind, name, answer in (
            (Empty, "~/reinitialize_global_localization", self._on_reinitialize),
            (LoadScan, "~/load_scan", self._on_load_scan),
        ):
            self._made.append(partial(self.destroy_service, self.create_service(kind, name, answer)))
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # goes on where simulated time stands still
        for timer in (
            self.create_timer(_WATCH_PERIOD_S, self._watch),
            self.create_timer(_DIAGNOSTICS_PERIOD_S, self._on_diagnostics_due, clock=steady),
        ):
            self._made.append(partial(self.destroy_timer, timer))

    def deactivate(self) -> None:
        """Stop listening."""
        for destroy in self._made:
            destroy()
        self._made = []

    def cleanup(self) -> None:
        """Withdraw the topics and forget the map."""
        for withdraw in self._offered:
            withdraw()
        self._offered = []

    def _load(self, paths: Sequence[Path]) -> None:
        """Build the localizer of one scan file or several; where that fails, what was there stays."""
        of = self.parameters
        candidates = [self._read(path) for path in paths]
        rng, choices = np.random.default_rng(of["seed"]), configuration(of)
        scan, scene = candidates[0]
        localizer: Localizer | FeatureLocalizer
        if len(candidates) == 1:
            localizer = build_localizer(scan, scene, choices, rng, self._tell_progress)
        else:
            named = {scene.name: (scan, scene) for scan, scene in candidates}
            if len(named) < len(candidates):
                names = ", ".join(scene.name for _, scene in candidates)
                raise ParameterError(f"candidate_scan_files: expected scenes of different names, got {names}")
            localizer = FeatureLocalizer(build_identifier(named, choices, rng, self._tell_progress))
        frame, reader = palm_pose.palm_frame(of, scene), StrainReader(scene)
        self._tracker = Tracker(localizer, of["max_gap_s"], of["patience_s"])
        self._scan, self._scan_file = scan, ", ".join(map(str, paths))
        self._frame, self._reader = frame, reader
        for path, (one, its_scene) in zip(paths, candidates, strict=True):
            sweeps = len(one.sweep_numbers)
            self.get_logger().info(f"{path}: {len(one)} pairs of {sweeps} sweeps, scene {its_scene.name}")

    def _read(self, path: Path) -> tuple[Scan, Scene]:
        """A scan and the scene to use it with."""
        with ScanStore.open(path) as store:
            scan, scene = store.load(), store.scene
        other = self.parameters["scene_file"]
        return scan, load_scene(given_or_shipped(other, "config/scenes")) if other else scene

    def _begin(self) -> None:
        self._tracker.interrupt()
        self._tracker.reset()
        self._clock_of_stamps = stamps.SendersClock()
        self._inputs = Inputs({"strain": 0, "palm_pose": 0, "initial_pose": 0})
        now_ns = self.get_clock().now().nanoseconds
        self._heard_ns = {"strain": now_ns, "palm_pose": now_ns}
        self._estimated_ns = now_ns
        self._arrived: set[str] = set()

    def _on_strain(self, message: StrainVectors) -> None:
        stamp_ns = stamps.to_ns(message.header.stamp)
        if not stamp_ns:
            return  # of a clock that does not run yet
        self._hear("strain", stamp_ns)
        try:
            estimates = self._tracker.add_strain(stamp_ns, *self._reader.read(message))
        except TactileLocalizerError as error:
            self._refuse("strain", error)
        else:
            self._publish(estimates)

    def _on_pose(self, message: PoseStamped) -> None:
        stamp_ns = stamps.to_ns(message.header.stamp)
        if not stamp_ns:
            return
        self._hear("palm_pose", stamp_ns)
        try:
            estimates = self._tracker.add_pose(stamp_ns, palm_pose.position(self._frame, message))
        except MeasurementError as error:
            self._refuse("palm_pose", error)
        else:
            self._publish(estimates)

    def _hear(self, topic: str, stamp_ns: int) -> None:
        self._arrived.add(topic)
        now_ns = self.get_clock().now().nanoseconds
        self._clock_of_stamps.hear(stamp_ns, now_ns, self._tracker.pairing.resets)

    @property
    def _now_ns(self) -> int:
        """Stamp of what is felt now, ns: what was felt before may come after a request, on a busy machine."""
        return self._clock_of_stamps.now_ns(self.get_clock().now().nanoseconds)

    def _publish(self, estimates: list[Estimate]) -> None:
        if estimates:
            self._arrived.add("estimate")
        for estimate in estimates:
            self._outputs.publish(estimate, self._tracker.localizer)

    def _on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        scene = self._tracker.localizer.scene
        try:
            mean = palm_pose.position(self._frame, PoseStamped(header=message.header, pose=message.pose.pose))
            std = posterior_messages.deviations(message, scene.axis_names)
            if not np.isfinite(std).all():
                raise MeasurementError(f"covariance: expected variances of at least 0, found {std**2}")
            if not ((mean >= scene.lower) & (mean <= scene.upper)).all():
                raise MeasurementError(f"expected a place in {scene.lower} to {scene.upper}, got {mean}")
        except MeasurementError as error:
            self._refuse("initial_pose", error)
            return
        self._tracker.seed(mean, std, self._now_ns)
        self.get_logger().info(f"belief seeded at {mean} with standard deviations {std}")

    def _on_reinitialize(self, request: Empty.Request, response: Empty.Response) -> Empty.Response:
        self._tracker.reset(self._now_ns)
        self.get_logger().info("belief spread over the whole scene")
        return response

    def _on_load_scan(self, request: LoadScan.Request, response: LoadScan.Response) -> LoadScan.Response:
        try:
            self._load([confined(request.path, self.parameters["scan_directory"])])
        except TactileLocalizerError as error:
            response.message = str(error)
            self.get_logger().error(f"load scan: {error}")
            return response
        self._begin()
        self._map.publish(self._scan, self._tracker.localizer.scene)
        response.success = True
        response.message = f"{self._scan_file}: {len(self._scan)} pairs"
        return response

    def _watch(self) -> None:
        """Tell when a position has become old, and when it is new again."""
        now_ns = self.get_clock().now().nanoseconds
        timeout_s = self.parameters["stale_timeout_s"]
        for topic, heard_ns in self._heard_ns.items():
            if topic in self._arrived or now_ns < heard_ns:
                self._heard_ns[topic] = now_ns
        if "estimate" in self._arrived or now_ns < self._estimated_ns:
            self._estimated_ns = now_ns
        self._arrived.clear()
        age_s = max((now_ns - self._estimated_ns) / NANOSECONDS, self._tracker.age_s)
        silent = [t for t, heard_ns in self._heard_ns.items() if now_ns - heard_ns > timeout_s * NANOSECONDS]
        was_stale, stale = bool(self._inputs.stale), ""
        if self._tracker.latest is not None and age_s > timeout_s:
            why = f"no {' and no '.join(silent or [self._tracker.behind])}"
            if self._tracker.trouble and not silent:
                why = self._tracker.trouble
            stale = f"{why}, nothing new for {age_s:.1f} s"
        self._inputs.stale, self._inputs.silent = stale, silent
        if bool(stale) != was_stale:
            self.get_logger().warning(f"stale: {stale}" if stale else "no longer stale")
        if stale and not was_stale:
            self._repeat_as_stale()

    def _repeat_as_stale(self) -> None:
        if self._tracker.latest is not None:
            self._outputs.publish(self._tracker.latest, self._tracker.localizer, self._inputs.stale)

    def _on_diagnostics_due(self) -> None:
        if self._inputs.stale:
            self._repeat_as_stale()
        message = DiagnosticArray()
        message.header.stamp = self.get_clock().now().to_msg()
        self._inputs.lost = self._reader.lost
        message.status = self._diagnostics.statuses(self._tracker, self._scan_file, self._inputs)
        self._health.publish(message)

    def _refuse(self, topic: str, error: TactileLocalizerError) -> None:
        self._inputs.unread[topic] += 1
        self.get_logger().error(f"{topic}: {error}", throttle_duration_sec=1.0)

    def _on_set(self, changed: list[rclpy.Parameter]) -> None:
        """Take over what may change while the belief is kept."""
        if self._offered and any(parameter.name in LIVE for parameter in changed):
            localizer, choices = self._tracker.localizer, configuration(self.parameters)
            localizer.adjust(convergence_criteria(localizer.scene, choices), choices.update_distance)

    def _tell_progress(self, text: str, share: float) -> None:
        self.get_logger().info(f"{text}: {share:.0%}", throttle_duration_sec=2.0)


def main() -> int:
    """Run the node."""
    return run(FilterNode)
