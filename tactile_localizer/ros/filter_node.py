"""Filter node: estimates the palm position on the material from strain vectors and palm poses.

Publishes ``~/posterior`` for each strain vector, with ``~/pose`` and ``~/converged``;
``~/particles`` and ``~/markers`` at a lower rate; ``~/map`` once (latched); ``/diagnostics`` at 1 Hz.
``~/initial_pose`` seeds the belief, ``~/reinitialize_global_localization`` resets it to uniform,
``~/load_scan`` replaces the map.

If strain or poses stop, the last estimate is repeated and marked as stale; it is never extrapolated.
"""

import re
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from rclpy.callback_groups import ReentrantCallbackGroup
from std_srvs.srv import Empty

from tactile_localizer.core.factory import convergence_criteria
from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.errors import (
    LiveError,
    MeasurementError,
    ParameterError,
    TactileLocalizerError,
    counted,
)
from tactile_localizer.io.scans.folder import ScanFolder, confined
from tactile_localizer.io.scans.learned import Ready, ready_localizer
from tactile_localizer.io.scans.recorder import StrainSample
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import given_or_shipped
from tactile_localizer.ros.base.background import run_in_thread
from tactile_localizer.ros.base.executable import run
from tactile_localizer.ros.base.managed_node import ManagedNode
from tactile_localizer.ros.diagnostics.filter import FilterDiagnostics
from tactile_localizer.ros.diagnostics.status import DiagnosticsPublisher, Increments
from tactile_localizer.ros.filter_parameters import LIVE, PARAMETERS, configuration
from tactile_localizer.ros.online_localizer import OnlineLocalizer
from tactile_localizer.ros.publishers.estimates import EstimatePublisher, standard_deviations
from tactile_localizer.ros.publishers.maps import MapPublisher
from tactile_localizer.ros.publishers.material_transform import MaterialBroadcaster
from tactile_localizer.ros.subscriptions.tactile_inputs import INPUTS, TactileInputs
from tactile_localizer.scene import Scene
from tactile_localizer.srv import LoadScan
from tactile_localizer.streams.findings import CLOCKS
from tactile_localizer.streams.runs import NANOSECONDS
from tactile_localizer.streams.session import Pair

_NUMBERS = re.compile(r"\d+ publishers?|[\d.]+")
_SAME_DELAY_S = 0.005
"""Difference of two delays of strain that matters less than where a map is known, s (judgement)."""
_WATCH_PERIOD_S, _WATCHES_PER_STATUS = 0.1, 10


@dataclass(frozen=True)
class LoadedScan:
    """A scan with the localizer built from it.

    Parameters
    ----------
    path : of the scan
    scene : of the scan; that of the localizer is cropped to the scan
    ready : localizer on the scan, and what is shown of the scan
    other_delay : a line where strain of the scan was late by another time than that given; else empty
    """

    path: Path
    scene: Scene
    ready: Ready
    other_delay: str

    @property
    def localizer(self) -> Localizer:
        """Localizer on the scan."""
        return self.ready.localizer


class FilterNode(ManagedNode):
    """Passes messages to an :class:`OnlineLocalizer` and publishes its estimates."""

    def __init__(self) -> None:
        super().__init__("tactile_filter", PARAMETERS)
        self._activations = 0
        self._is_loading = False
        self.create_service(
            LoadScan, "~/load_scan", self._on_load_scan, callback_group=ReentrantCallbackGroup()
        )

    def configure(self) -> None:
        """Load the map, build the localizer, create the publishers."""
        parameters = self.parameters
        if not parameters["scan_file"]:
            raise ParameterError("scan_file: expected a path, got none")
        self._health = DiagnosticsPublisher(self)
        self._diagnostics = FilterDiagnostics(self._health)
        self._inputs = TactileInputs(self, self._on_pairs)
        self._material = None
        if parameters["publish_tf"]:
            frames = parameters["reference_frame"], parameters["material_frame"]
            self._material = MaterialBroadcaster(self, *frames, parameters["material_pose"])
        self._loaded = self._load(Path(parameters["scan_file"]).expanduser())
        self._estimates = EstimatePublisher(self, parameters)
        self._map = MapPublisher(self, parameters["material_frame"])
        self.add_post_set_parameters_callback(self._on_set)
        self.defer(partial(self.remove_post_set_parameters_callback, self._on_set))

    def activate(self) -> None:
        """Subscribe to the inputs; the belief is uniform."""
        self._activations += 1
        self._start(self._loaded)
        self.defer(self._log_counts)
        self._inputs.subscribe()
        self.defer(self._inputs.take_waiting)
        self.create_subscription(PoseWithCovarianceStamped, "~/initial_pose", self._on_initial_pose, 10)
        self.create_service(Empty, "~/reinitialize_global_localization", self._on_reinitialize)
        self._watches = 0
        self.create_timer(_WATCH_PERIOD_S, self._watch)

    def _log_counts(self) -> None:
        """Log what became of the strain since the map was loaded."""
        received, counts = self._inputs.received["strain"], self._online.counts
        without = counts["without a pose"] + self._inputs.session.waiting
        self.get_logger().info(
            f"{received} strain vectors received, {self._online.estimates} posteriors, "
            f"{without} without a pose, {self._inputs.lost} lost in transport"
        )

    def _report_progress(self, activity: str, fraction: float) -> None:
        """Report in log and diagnostics that ``fraction`` of ``activity`` is done."""
        message, values = f"{activity}: {fraction:.0%}", {"fraction": f"{fraction:.2f}"}
        self.get_logger().info(message)
        self._health.publish(self._health.status("map", DiagnosticStatus.OK, message, values))

    def _load(self, path: Path) -> LoadedScan:
        """Build the localizer of a scan; what is learned of it, which takes seconds, is stored with the scan.

        Raises
        ------
        TactileLocalizerError
            The scan or a parameter is invalid, or they are inconsistent.
        """
        parameters, progress, folder = self.parameters, self._report_progress, ScanFolder(path)
        scene = folder.scene
        if parameters["scene_file"]:
            scene = load_scene(given_or_shipped(parameters["scene_file"], "config/scenes"))
        rng = np.random.default_rng(parameters["seed"])
        ready = ready_localizer(path, scene, configuration(parameters), rng, progress)
        pairs, sweeps = counted(ready.contents.pairs, "pair"), counted(ready.contents.sweeps, "sweep")
        self.get_logger().info(f"{path}: {pairs} of {sweeps}, scene {scene.name}")
        given_s, scanned_s = parameters["strain_delay_s"], folder.strain_delay_s
        other = f"strain_delay_s is {given_s:g} s, in the scan it is {scanned_s:g} s"
        if abs(given_s - scanned_s) <= _SAME_DELAY_S:
            other = ""
        else:
            self.get_logger().warning(other)
        return LoadedScan(path, scene, ready, other)

    def _start(self, loaded: LoadedScan) -> None:
        """Localize on a map, from a uniform belief; on an error the present one stays in use."""
        scene, contents = loaded.scene, loaded.ready.contents
        bounds = replace(loaded.ready.bounds, extent=np.where(scene.wraps, np.inf, scene.extent))
        online = OnlineLocalizer(loaded.localizer, self.parameters["max_gap_s"], bounds)
        self._map.publish(contents.tactile_map)
        self._inputs.start(loaded.scene)
        self._loaded, self._online = loaded, online
        self._stale = ""
        self._warned: set[str] = set()
        self._arrivals = Increments()
        self._last_ns = dict.fromkeys((*INPUTS, "estimate"), self.now_ns)
        self._age_s = dict.fromkeys(self._last_ns, 0.0)

    def _on_pairs(self, pairs: list[Pair[StrainSample]]) -> None:
        self._publish(self._online.take(pairs))

    def _publish(self, estimates: list[Estimate]) -> None:
        for estimate in estimates:
            self._estimates.publish(estimate, self._loaded.localizer)
        if estimates and self._material is not None and self._online.palm is not None:
            axes = self._loaded.localizer.scene.axis_names
            self._material.publish(estimates[-1], axes, self._online.palm)

    def _on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        scene = self._loaded.localizer.scene
        try:
            mean = self._inputs.position(PoseStamped(header=message.header, pose=message.pose.pose))
            std = standard_deviations(message, scene.axis_names)
            if not np.isfinite(std).all():
                raise MeasurementError(f"covariance: expected variances of at least 0, found {std**2}")
            if not ((mean >= scene.lower) & (mean <= scene.upper)).all():
                raise MeasurementError(f"position: expected {scene.lower} to {scene.upper}, got {mean}")
        except MeasurementError as error:
            self._inputs.reject("initial_pose", error)
            return
        self._online.seed(mean, std, self._inputs.present_ns())
        self._stale = ""
        self.get_logger().info(f"belief seeded at {mean} with standard deviations {std}")

    def _on_reinitialize(self, request: Empty.Request, response: Empty.Response) -> Empty.Response:
        self._online.reset(self._inputs.present_ns())
        self._stale = ""
        self.get_logger().info("belief reset to uniform")
        return response

    async def _on_load_scan(
        self, request: LoadScan.Request, response: LoadScan.Response
    ) -> LoadScan.Response:
        """Load the new map in the background while localization continues on the present one."""
        is_first, self._is_loading = not self._is_loading, True
        activation = self._activations
        try:
            response.result = response.BUSY  # in each step, the result if it fails
            if not is_first:
                raise LiveError("expected no load in progress, found one")
            response.result = response.NOT_ACTIVE
            self._require_active(activation)
            response.result = response.NOT_ALLOWED
            path = confined(request.path, self.parameters["scan_directory"])
            response.result = response.NOT_USABLE
            loaded = await run_in_thread(self, partial(self._load, path))
            response.result = response.NOT_ACTIVE
            self._require_active(activation)
            response.result = response.NOT_USABLE
            self._start(loaded)
            response.success, response.result = True, response.SUCCESS
            response.message = f"{path}: {counted(loaded.ready.contents.pairs, 'pair')}"
        except TactileLocalizerError as error:
            response.message = str(error)
            self.get_logger().error(f"load scan: {error}")
        finally:
            self._is_loading = not is_first
        return response

    def _require_active(self, activation: int) -> None:
        if not self.is_active or self._activations != activation:
            raise LiveError("expected an active node, it is inactive")

    def _watch(self) -> None:
        """Detect whether the estimate is stale, and log when that changes."""
        now_ns = self.now_ns
        timeout_s = self.parameters["stale_timeout_s"]
        arrived = self._arrivals.since({**self._inputs.received, "estimate": self._online.estimates})
        for name, last_ns in self._last_ns.items():
            if arrived.get(name) or not 0 < last_ns <= now_ns:  # simulated time starts, or restarts
                self._last_ns[name] = now_ns
        self._age_s = {name: (now_ns - last_ns) / NANOSECONDS for name, last_ns in self._last_ns.items()}
        age_s = self._age_s["estimate"]
        if self._online.latest is not None:
            session = self._inputs.session
            newest_ns = session.newest_input_ns - max(session.delay_ns, 0)
            behind_ns = newest_ns - self._online.latest.stamp_ns
            age_s = max(age_s, behind_ns / NANOSECONDS)
        was_stale = bool(self._stale)
        self._stale = f"{self._missing()}, no estimate for {age_s:.1f} s" if age_s > timeout_s else ""
        if self._stale:
            self._warn()
        elif self._warned:
            self._warned.clear()
            self.get_logger().warning("no longer stale")
        if self._stale and not was_stale:
            self._repeat_as_stale()
        self._watches += 1
        if self._watches % _WATCHES_PER_STATUS == 0:  # a second timer would slow the executor down
            self._health.publish(*self._statuses())

    def _warn(self) -> None:
        """Log why the estimate is stale: each reason once, whatever its numbers."""
        kind = _NUMBERS.sub("", self._stale)
        if kind not in self._warned:
            self._warned.add(kind)
            self.get_logger().warning(f"stale: {self._stale}")

    def _missing(self) -> str:
        """Why there is no new estimate."""
        inputs = self._inputs
        sparse = inputs.sparsity(self._age_s["palm_pose"])
        if silent := [topic for topic in self._silent() if topic == "strain" or not sparse]:
            return " and ".join(map(inputs.absence, silent))
        strain_ns, pose_ns = inputs.session.newest_ns or 0, inputs.session.newest_pose_ns or 0
        late = "palm_pose" if pose_ns < strain_ns else "strain"
        invalid = map(inputs.problems.get, INPUTS)
        reasons = (*invalid, sparse, inputs.finding(CLOCKS), self._online.last_error)
        return next(filter(None, reasons), inputs.absence(late))

    def _silent(self) -> list[str]:
        """Topics of which nothing has arrived recently."""
        return [topic for topic in INPUTS if self._age_s[topic] > self.parameters["stale_timeout_s"]]

    def _problem(self) -> str:
        """What is wrong with the inputs; empty if nothing is."""
        missing = self._stale or (self._missing() if self._silent() else "")
        inputs = self._inputs
        return missing or inputs.mixed() or inputs.finding() or self._loaded.other_delay

    def _repeat_as_stale(self) -> None:
        """Publish the last estimate, or that there is none yet, with the reason."""
        localizer = self._loaded.localizer
        if self._online.latest is not None:
            self._estimates.publish(self._online.latest, localizer, self._stale)
        else:
            reason = self._stale or f"no estimate yet, {self._missing()}"
            self._estimates.publish_waiting(self._inputs.newest_ns or self.now_ns, localizer, reason)

    def _statuses(self) -> list[DiagnosticStatus]:
        if self._stale or self._online.latest is None:
            self._repeat_as_stale()
        return [
            self._diagnostics.belief(self._online, str(self._loaded.path), self._stale),
            self._diagnostics.inputs(self._inputs, self._online, self._problem(), bool(self._stale)),
        ]

    def _on_set(self, changed: list[rclpy.Parameter]) -> None:
        """Adopt live parameters without a reset of the belief."""
        if any(parameter.name in LIVE for parameter in changed):
            choices = configuration(self.parameters)
            criteria = convergence_criteria(self._loaded.localizer.scene, choices)
            self._loaded.localizer.adjust(criteria, choices.update_distance)


def main() -> int:
    """Run the node; returns the exit status."""
    return run(FilterNode)
