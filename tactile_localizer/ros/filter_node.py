"""Filter node: strain vectors and palm poses to a belief about where the palm is on the material.

Publishes ``~/posterior`` for each strain vector, ``~/pose``, ``~/converged`` and ``~/covariance_trace``
beside it, ``~/particles`` and ``~/markers`` at a lower rate, ``~/map`` once (kept for late subscribers) and
``/diagnostics`` at 1 Hz. ``~/initial_pose`` seeds the belief, ``~/reinitialize_global_localization`` makes it
uniform, ``~/load_scan`` changes the map. With several scans ``~/feature`` has the probability of each.

A position is never made up: when strain or poses stop, the last one is repeated, marked as stale.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_srvs.srv import Empty

from tactile_localizer.core.factory import convergence_criteria
from tactile_localizer.core.geometry.pose_buffer import NANOSECONDS
from tactile_localizer.core.localizer import Estimate
from tactile_localizer.errors import MeasurementError, ParameterError, TactileLocalizerError
from tactile_localizer.io.confinement import confined
from tactile_localizer.msg import StrainVectors
from tactile_localizer.ros.base.background_task import in_background
from tactile_localizer.ros.base.executable import run
from tactile_localizer.ros.base.managed_node import ManagedNode
from tactile_localizer.ros.conversions import posteriors, timestamps
from tactile_localizer.ros.conversions.palm_poses import position
from tactile_localizer.ros.conversions.strain_vectors import StrainReader
from tactile_localizer.ros.diagnostics.filter import FilterDiagnostics, Inputs
from tactile_localizer.ros.localization.map_loading import LoadedMap, load_map
from tactile_localizer.ros.localization.online_localizer import OnlineLocalizer
from tactile_localizer.ros.parameters.filter import LIVE, PARAMETERS, configuration
from tactile_localizer.ros.publishers.estimates import FilterOutputs
from tactile_localizer.ros.publishers.maps import MapPublisher
from tactile_localizer.ros.publishers.material_transform import MaterialBroadcaster
from tactile_localizer.ros.subscriptions import palm_poses
from tactile_localizer.ros.subscriptions.draining import Topic, hear
from tactile_localizer.ros.subscriptions.sender_clock import SendersClock
from tactile_localizer.srv import LoadScan

_BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
_WATCH_PERIOD_S = 0.1
_DIAGNOSTICS_PERIOD_S = 1.0
_PROGRESS_PERIOD_S = 0.5


class FilterNode(ManagedNode):
    """Feeds a :class:`OnlineLocalizer` with messages and publishes its estimates."""

    def __init__(self) -> None:
        super().__init__("filter", PARAMETERS)
        self._offered: list[Callable[[], Any]] = []  # withdraw what is there while configured
        self._made: list[Callable[[], Any]] = []  # destroy what is there while active
        self._is_loading = False
        self._doing, self._told_s = "", -math.inf
        self.create_service(
            LoadScan, "~/load_scan", self._on_load_scan, callback_group=ReentrantCallbackGroup()
        )
        self.add_post_set_parameters_callback(self._on_set)

    def configure(self) -> None:
        """Load the map, build the localizer, offer the topics."""
        files = self.parameters["candidate_scan_files"] or [self.parameters["scan_file"]]
        if not all(files):
            raise ParameterError("scan_file: expected a path, got none")
        self._health = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._offered = [partial(self.destroy_publisher, self._health)]
        self._diagnostics = FilterDiagnostics(self.get_fully_qualified_name().lstrip("/"))
        of = self.parameters
        self._lookup = palm_poses.lookup(of, self._on_pose, partial(self._refuse, "palm_pose"))
        self._material = None
        if of["publish_tf"]:
            frames = of["reference_frame"], of["material_frame"]
            self._material = MaterialBroadcaster(self, *frames, of["material_pose"])
            self._offered.append(self._material.close)
        self._use(self._load([Path(file).expanduser() for file in files]))
        self._outputs = FilterOutputs(self, self.parameters)
        self._map = MapPublisher(self, self.parameters["material_frame"])
        self._offered += [self._outputs.close, self._map.close]

    def activate(self) -> None:
        """Listen; the belief begins anew."""
        self._begin()
        self._map.publish(self._loaded.scan, self._tracker.localizer.scene)
        heard = (
            Topic(StrainVectors, "strain", self._on_strain, _BEST_EFFORT),
            *palm_poses.pose_topics(self._lookup, self._on_pose),
            Topic(PoseWithCovarianceStamped, "~/initial_pose", self._on_initial_pose, QoSProfile(depth=10)),
        )
        self._made = [partial(self.destroy_subscription, one) for one in hear(self, heard)]
        spread = self.create_service(Empty, "~/reinitialize_global_localization", self._on_reinitialize)
        self._made.append(partial(self.destroy_service, spread))
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

    def _load(self, paths: Sequence[Path]) -> LoadedMap:
        """The localizer of one scan file or several; takes seconds where a scan has to be calibrated."""
        loaded = load_map(paths, self.parameters, self._tell_progress)
        for path, scan, scene in zip(paths, loaded.scans, loaded.scenes, strict=True):
            sweeps = len(scan.sweep_numbers)
            self.get_logger().info(f"{path}: {len(scan)} pairs of {sweeps} sweeps, scene {scene.name}")
        self._tell_progress("map built", 1.0)
        return loaded

    def _use(self, loaded: LoadedMap) -> None:
        """Localize on another map from now on; where that fails, the present one stays."""
        of, reader = self.parameters, StrainReader(loaded.scenes[0])
        self._tracker = OnlineLocalizer(loaded.localizer, of["max_gap_s"], of["patience_s"], loaded.ranges)
        self._loaded, self._frame, self._reader = loaded, loaded.frame, reader

    def _begin(self) -> None:
        self._tracker.interrupt()
        self._tracker.reset()
        self._clock_of_stamps = SendersClock()
        self._inputs = Inputs({"strain": 0, "palm_pose": 0, "initial_pose": 0})
        now_ns = self.get_clock().now().nanoseconds
        self._heard_ns = {"strain": now_ns, "palm_pose": now_ns}
        self._estimated_ns = now_ns
        self._arrived: set[str] = set()

    def _on_strain(self, message: StrainVectors) -> None:
        stamp_ns = timestamps.to_ns(message.header.stamp)
        if not stamp_ns:
            return  # of a clock that does not run yet
        self._hear("strain", stamp_ns)
        try:
            estimates = self._tracker.add_strain(stamp_ns, *self._reader.read(message))
        except TactileLocalizerError as error:
            self._refuse("strain", error)
        else:
            self._publish(estimates)
        if self._lookup is not None:
            self._lookup.look_up(stamp_ns)

    def _on_pose(self, message: PoseStamped) -> None:
        stamp_ns = timestamps.to_ns(message.header.stamp)
        if not stamp_ns:
            return
        self._hear("palm_pose", stamp_ns)
        try:
            estimates = self._tracker.add_pose(stamp_ns, position(self._frame, message))
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
        """Stamp of a strain that is measured now, ns; on a busy machine older ones arrive after a request."""
        return self._clock_of_stamps.now_ns(self.get_clock().now().nanoseconds)

    def _publish(self, estimates: list[Estimate]) -> None:
        if estimates:
            self._arrived.add("estimate")
        for estimate in estimates:
            self._outputs.publish(estimate, self._tracker.localizer)
        if estimates and self._material is not None and self._tracker.palm is not None:
            axes = self._tracker.localizer.scene.axis_names
            self._material.publish(estimates[-1], axes, self._tracker.palm)

    def _on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        scene = self._tracker.localizer.scene
        try:
            mean = position(self._frame, PoseStamped(header=message.header, pose=message.pose.pose))
            std = posteriors.deviations(message, scene.axis_names)
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

    async def _on_load_scan(
        self, request: LoadScan.Request, response: LoadScan.Response
    ) -> LoadScan.Response:
        """Build the new map in the background, and go on with the old one until it is there."""
        if self._is_loading:
            response.result, response.message = response.BUSY, "expected no other scan to be loading"
        elif not self._made:
            response.result, response.message = response.NOT_ACTIVE, "expected an active node"
        else:
            self._is_loading = True
            try:
                await self._answer_load(request.path, response)
            finally:
                self._is_loading = False
        response.success = response.result == response.SUCCESS
        if not response.success:
            self.get_logger().error(f"load scan: {response.message}")
        return response

    async def _answer_load(self, path: str, response: LoadScan.Response) -> None:
        try:
            found = confined(path, self.parameters["scan_directory"])
        except TactileLocalizerError as error:
            response.result, response.message = response.NOT_ALLOWED, str(error)
            return
        active = self._made
        try:
            loaded = await in_background(self, partial(self._load, [found]))
            if self._made is not active:
                response.result, response.message = response.NOT_ACTIVE, "the node was deactivated meanwhile"
                return
            self._change_to(loaded)
        except TactileLocalizerError as error:
            response.result, response.message = response.NOT_USABLE, str(error)
            return
        response.result, response.message = response.SUCCESS, f"{found}: {len(loaded.scan)} pairs"

    def _change_to(self, loaded: LoadedMap) -> None:
        """Start anew on another map; after any failure the old one is back."""
        before = self._loaded
        try:
            self._use(loaded)
            self._begin()
            self._map.publish(loaded.scan, self._tracker.localizer.scene)
        except Exception:
            self._use(before)
            self._begin()
            raise

    def _watch(self) -> None:
        """Report when the position becomes stale, and when it is fresh again."""
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
        message.status = self._diagnostics.statuses(self._tracker, self._loaded.name, self._inputs)
        self._health.publish(message)

    def _refuse(self, topic: str, error: TactileLocalizerError) -> None:
        self._inputs.unread[topic] += 1
        self.get_logger().error(f"{topic}: {error}", throttle_duration_sec=1.0)

    def _on_set(self, changed: list[rclpy.Parameter]) -> None:
        """Adopt live parameters; the belief stays."""
        if self._offered and any(parameter.name in LIVE for parameter in changed):
            localizer, choices = self._tracker.localizer, configuration(self.parameters)
            localizer.adjust(convergence_criteria(localizer.scene, choices), choices.update_distance)

    def _tell_progress(self, text: str, share: float) -> None:
        """Report in the log and in the diagnostics how far the map is built."""
        now_s = time.monotonic()
        if share == 1.0 or text != self._doing or now_s - self._told_s > _PROGRESS_PERIOD_S:
            self._doing, self._told_s = text, now_s
            self.get_logger().info(f"{text}: {share:.0%}")
            message = DiagnosticArray(status=[self._diagnostics.progress(text, share)])
            message.header.stamp = self.get_clock().now().to_msg()
            self._health.publish(message)


def main() -> int:
    """Run the node."""
    return run(FilterNode)
