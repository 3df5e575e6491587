"""The course of the demonstration: asks the nodes for sweeps, shows and evaluates their estimates."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from rich.console import Console
from rich.live import Live
from rich.text import Text
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Bool
from std_srvs.srv import Empty, Trigger

from tactile_localizer.demo.nodes import NodeProcess, Nodes, own_domain, shipped
from tactile_localizer.errors import LiveError
from tactile_localizer.io.bags.writer import BagWriter
from tactile_localizer.msg import Posterior, ScanStatus, StrainVectors
from tactile_localizer.offline.metrics import INCH
from tactile_localizer.resources import resource_path
from tactile_localizer.ros.base.qos import STRAIN
from tactile_localizer.ros.conversions import to_ns
from tactile_localizer.scene import Scene
from tactile_localizer.sim.hand import PHALANGES
from tactile_localizer.sim.scan import TRAINING_SWEEPS, sweep_plan
from tactile_localizer.sim.sweep import SPEED_MPS, simulate_sweep

SCAN_SWEEPS = 2 * TRAINING_SWEEPS
"""Number of training sweeps: two along each line, so that the noise between sweeps can be learned."""
LIMIT_M = 0.1 * INCH
"""Error after contact reported in the paper, a tenth of an inch, m."""

_TIMEOUT_S = 120.0
"""Time limit for each step: a start, a sweep, the loading of the scan, s."""
_POLL_S = 0.02
_REFRESH_S = 0.15
_COLUMNS, _ROWS, _SHADES = 64, 16, " ·░▒▓"
_RELIABLE = QoSProfile(depth=100)
_LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)

TOPICS: dict[str, tuple[Any, QoSProfile]] = {
    "strain": (StrainVectors, STRAIN),
    "palm_pose": (PoseStamped, _RELIABLE),
    "simulator/ground_truth": (PoseStamped, _RELIABLE),
    "simulator/sweep_active": (Bool, _LATCHED),
    "mapping/status": (ScanStatus, _LATCHED),
    "filter/posterior": (Posterior, _RELIABLE),
    "filter/particles": (PointCloud2, _RELIABLE),
    "/diagnostics": (DiagnosticArray, _RELIABLE),
}
"""Recorded topics: message type and quality of service."""


class Watcher:
    """A node that receives topics and calls services of other nodes; it spins while something is waited for.

    Signals to end raise :class:`KeyboardInterrupt` in :meth:`until` only: elsewhere it would interrupt rclpy,
    or the end of other processes.

    Parameters
    ----------
    domain : ROS domain id
    sink : called with topic, time of receipt (ns) and serialised message of every message

    Attributes
    ----------
    received : number of messages received, by topic
    """

    def __init__(self, domain: int, sink: Callable[[str, int, bytes], None] = lambda *_: None) -> None:
        self.received: Counter[str] = Counter()
        self._sink = sink
        self._is_interrupted = False
        self._handlers = {
            number: signal.signal(number, self._on_signal)
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
            if signal.getsignal(number) is not signal.SIG_IGN  # nohup
        }
        self._context = Context()
        rclpy.init(args=[], context=self._context, domain_id=domain)
        self._node = Node("watcher", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)

    def close(self) -> None:
        """Leave the ROS graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self._is_interrupted = True

    def listen(self, kind: Any, topic: str, quality: QoSProfile, work: Callable[[Any], None]) -> None:
        """Subscribe to a topic; ``work`` is called with each message."""
        name = self._node.resolve_topic_name(topic)

        def take(raw: bytes) -> None:
            self.received[topic] += 1
            self._sink(name, time.time_ns(), raw)
            work(deserialize_message(raw, kind))

        self._node.create_subscription(kind, topic, take, quality, raw=True)

    def until(
        self,
        condition: Callable[[], Any],
        what: str,
        meanwhile: Callable[[], None] = lambda: None,
        timeout_s: float = _TIMEOUT_S,
    ) -> None:
        """Spin, and call ``meanwhile`` often, until ``condition`` is true.

        Raises
        ------
        LiveError
            It is not true in time.
        KeyboardInterrupt
            The process was asked to end.
        """
        deadline = time.monotonic() + timeout_s
        while not condition():
            if self._is_interrupted:
                raise KeyboardInterrupt
            if time.monotonic() > deadline:
                raise LiveError(f"waited {timeout_s:g} s for {what}")
            self._executor.spin_once(timeout_sec=_POLL_S)
            meanwhile()

    def call(self, kind: Any, service: str, request: Any = None) -> Any:
        """Call a service and return its response.

        Raises
        ------
        LiveError
            The service is not available, does not respond in time, or rejects the request.
        """
        client = self._node.create_client(kind, service)
        self.until(client.service_is_ready, f"service {service}")
        future = client.call_async(request if request is not None else kind.Request())
        self.until(future.done, f"an answer of service {service}")
        self._node.destroy_client(client)
        response = future.result()
        if not getattr(response, "success", True):
            raise LiveError(f"service {service}: {response.message}")
        return response


@dataclass
class Observations:
    """Received messages.

    Parameters
    ----------
    posteriors : posteriors since the beginning of the sweep that are not stale
    truths : stamps (ns) and true positions x, y (m) since the beginning of the sweep
    active : received values of ``simulator/sweep_active``
    particles : newest particles: x and y (m) in the first columns, weight in the last
    diagnostics : newest values of each diagnostic status, by its name
    """

    posteriors: list[Posterior] = field(default_factory=list)
    truths: list[tuple[int, float, float]] = field(default_factory=list)
    active: list[bool] = field(default_factory=list)
    particles: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    diagnostics: dict[str, dict[str, str]] = field(default_factory=dict)

    def add(self, topic: str, message: Any) -> None:
        """Add a message of a topic."""
        if topic == "simulator/ground_truth":
            place = message.pose.position
            self.truths.append((to_ns(message.header.stamp), place.x, place.y))
        elif topic == "simulator/sweep_active":
            self.active.append(message.data)
        elif topic == "filter/posterior" and not message.stale:
            self.posteriors.append(message)
        elif topic == "filter/particles":
            self.particles = np.frombuffer(message.data, dtype="<f4").reshape(message.width, -1)
        elif topic == "/diagnostics":
            for status in message.status:
                self.diagnostics[status.name] = {value.key: value.value for value in status.values}

    @property
    def estimated_ns(self) -> int:
        """Stamp of the newest posterior, ns; 0 before the first."""
        return to_ns(self.posteriors[-1].header.stamp) if self.posteriors else 0

    def sweep(self, end_ns: int, contact: tuple[float, float] | None) -> LiveSweep:
        """The finished sweep: its estimates up to ``end_ns``, and the interpolated truth at their stamps."""
        truths = np.array(self.truths)
        known_ns = np.array([stamp_ns for stamp_ns, _, _ in self.truths])
        inside = [p for p in self.posteriors if known_ns[0] <= to_ns(p.header.stamp) <= end_ns]
        stamp_s = np.array([to_ns(p.header.stamp) - known_ns[0] for p in inside]) * 1e-9
        known_s = (known_ns - known_ns[0]) * 1e-9
        truth = np.stack([np.interp(stamp_s, known_s, truths[:, axis]) for axis in (1, 2)], axis=1)
        mean, converged = np.array([p.mean for p in inside]), np.array([p.converged for p in inside])
        return LiveSweep(stamp_s, mean, truth, converged, contact)


@dataclass(frozen=True)
class LiveSweep:
    """The n estimates of a sweep, and the truth at their stamps.

    Parameters
    ----------
    stamp_s : (n,) time since the start of the sweep, s
    mean, truth : (n, 2) m, x and y
    converged : (n,) bool
    contact : x of contact with the feature and of its end, m; ``None`` if the sweep passes beside it
    """

    stamp_s: np.ndarray
    mean: np.ndarray
    truth: np.ndarray
    converged: np.ndarray
    contact: tuple[float, float] | None

    @property
    def error(self) -> np.ndarray:
        """Distance between estimate and truth, (n,), m."""
        return np.linalg.norm(self.mean - self.truth, axis=1)

    def outcome(self) -> dict[str, Any]:
        """Errors and convergence, by name; ``None`` for an undefined value."""
        begin, end = self.contact or (np.inf, -np.inf)
        x = self.truth[:, 0]
        during = (x >= begin) & (x <= end)
        first = int(np.argmax(self.converged)) if self.converged.any() else None
        return {
            "start_mm": (self.truth[0] * 1e3).round(2),
            "error_after_contact_mm": _mean_mm(self.error[during]),
            "error_converged_mm": _mean_mm(self.error[during & self.converged]),
            "converged": bool(self.converged[during].any()),
            "converged_before_contact": first is not None and bool(x[first] < begin),
            "time_to_convergence_s": None if first is None else float(self.stamp_s[first]),
            "travel_to_convergence_mm": None if first is None else 1e3 * float(abs(x[first] - x[0])),
        }


def contact_of(feature: str, seed: int, number: int, speed: float, rate: float) -> tuple[float, float] | None:
    """x at contact of a simulated test sweep and at the feature's end, m; ``None`` if it passes beside it."""
    start, end = sweep_plan("test", number, seed)
    sweep = simulate_sweep(feature, seed, number, "test", start=start, end=end, speed=speed, rate=rate)
    if sweep.contact < 0:
        return None
    return float(sweep.truth[sweep.contact, 0]), float(sweep.truth[sweep.feature_end, 0])


def summarize(sweeps: Sequence[LiveSweep]) -> dict[str, Any]:
    """Means over the sweeps, by name; ``within_limit``: the mean error after contact is at most 0.1 inch."""
    outcomes = [{"sweep": number, **sweep.outcome()} for number, sweep in enumerate(sweeps)]

    def mean(name: str) -> float | None:
        values = [one[name] for one in outcomes if one[name] is not None]
        return float(np.mean(values)) if values else None

    error = mean("error_after_contact_mm")
    means = ("error_converged_mm", "time_to_convergence_s", "travel_to_convergence_mm")
    return {
        "error_after_contact_mm": error,
        "within_limit": error is not None and error <= LIMIT_M * 1e3,
        "converged_sweeps": sum(one["converged"] for one in outcomes),
        "converged_before_contact": sum(one["converged_before_contact"] for one in outcomes),
        **{name: mean(name) for name in means},
        "sweeps": outcomes,
    }


def _mean_mm(error: np.ndarray) -> float | None:
    return 1e3 * float(error.mean()) if len(error) else None


class View:
    """Prints one line per event; on a terminal a map of the material moves below them.

    Parameters
    ----------
    console : console for the output
    scene : scene of the demonstration
    """

    def __init__(self, console: Console, scene: Scene) -> None:
        self._console, self._scene = console, scene
        self._live = Live(console=console, auto_refresh=False) if console.is_terminal else None
        self._begun_s, self._shown_s = time.monotonic(), 0.0
        self._line = ""

    def __enter__(self) -> View:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def say(self, text: str) -> None:
        """Print a line, unless it is the last one or empty."""
        if text and text != self._line:
            elapsed_s = time.monotonic() - self._begun_s
            self._console.print(f"{elapsed_s:5.1f} s  {text}", highlight=False, soft_wrap=True)
            self._line = text

    def show(self, observations: Observations) -> None:
        """Show the newest observations; called often."""
        if self._live is not None and time.monotonic() - self._shown_s > _REFRESH_S:
            self._shown_s = time.monotonic()
            self._live.update(material_map(self._scene, observations), refresh=True)


def material_map(scene: Scene, observations: Observations) -> Text:
    """Map in characters: particles as shades, truth ``o``, estimate ``x``; below it the reason."""
    density = np.zeros((_ROWS, _COLUMNS))
    particles = observations.particles
    if len(particles):
        np.add.at(density, _cells(scene, particles[:, :2]), particles[:, -1])
    levels = np.ceil((len(_SHADES) - 1) * np.sqrt(density / max(density.max(), 1e-9))).astype(int)
    marks = np.array(list(_SHADES))[levels]
    reason = ""
    if observations.posteriors:
        posterior = observations.posteriors[-1]
        marks[_cells(scene, np.array([posterior.mean]))] = "x"
        reason = posterior.reason
    if observations.truths:
        marks[_cells(scene, np.array([observations.truths[-1][1:]]))] = "o"
    return Text("\n".join(["".join(row) for row in marks] + [reason]))


def _cells(scene: Scene, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of positions (n, 2), m; positions outside the bounds are clipped to the edge."""
    relative = np.clip((positions - scene.lower) / scene.extent, 0.0, 1.0 - 1e-9)
    return ((1 - 1e-9 - relative[:, 1]) * _ROWS).astype(int), (relative[:, 0] * _COLUMNS).astype(int)


@dataclass(frozen=True)
class DemoSettings:
    """Settings of the demonstration.

    Parameters
    ----------
    feature : feature in the simulated material
    folder : output folder; the output of an earlier demonstration is replaced
    seed : seed of all random processes
    speed : simulated seconds per second of real time
    sweeps : number of sweeps to localize
    """

    feature: str
    folder: Path
    seed: int = 1
    speed: float = 10.0
    sweeps: int = 18

    @property
    def scan(self) -> Path:
        """The scan that the demonstration records."""
        return self.folder / "scan"


def run_demo(settings: DemoSettings, view: View) -> tuple[list[LiveSweep], dict[str, Any]]:
    """Start the nodes, scan, localize, stop the nodes; returns the sweeps and counts by name.

    Raises
    ------
    LiveError
        A node ended or did not respond.
    """
    logs = _fresh(settings)
    with own_domain() as domain:
        os.environ.update(domain.environment)
        types = {
            f"/{topic.lstrip('/')}": f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
            for topic, (kind, _) in TOPICS.items()
        }
        with (
            BagWriter(settings.folder / "bag", types) as bag,
            contextlib.closing(Watcher(domain.number, bag.write)) as watcher,
            Nodes(logs, domain.environment) as nodes,
        ):
            demo = _Demo(settings, view, watcher, nodes)
            demo.scan(domain.bus, logs)
            return demo.localize(), demo.counts()


class _Demo:
    def __init__(self, settings: DemoSettings, view: View, watcher: Watcher, nodes: Nodes) -> None:
        self._settings, self._view, self._watcher, self._nodes = settings, view, watcher, nodes
        self._seen = Observations()
        for topic, (kind, quality) in TOPICS.items():
            watcher.listen(kind, topic, quality, partial(self._seen.add, topic))

    def scan(self, bus: dict[str, Any], logs: Path) -> None:
        """Start simulator, driver and mapping, and record the training sweeps."""
        settings = self._settings
        self._view.say("starting simulator, driver and mapping")
        simulated = {"feature": settings.feature, "seed": settings.seed, "speed": settings.speed}
        self._nodes.start("simulator", {**bus, **simulated})
        self._nodes.start("driver", {**bus, "tare_file": str(logs / "tare.yaml")})
        scene = str(resource_path(f"config/scenes/{settings.feature}.yaml"))
        self._nodes.start("mapping", {"scan_file": str(settings.scan), "scene_file": scene})
        recording = self._seen.diagnostics
        self._until(lambda: int(recording.get("mapping: scan", {}).get("poses", 0)), "poses in the mapping")
        self._until(lambda: self._watcher.received["strain"], "strain")
        self._view.say("scanning, two sweeps along each line")
        for number in range(SCAN_SWEEPS):
            self._watcher.call(Trigger, "simulator/prepare")
            self._watcher.call(Trigger, "mapping/start_sweep")
            self._sweep()
            self._watcher.call(Trigger, "mapping/end_sweep")
            if (number + 1) % 7 == 0:
                self._view.say(f"{number + 1} of {SCAN_SWEEPS} sweeps")
        self._nodes.stop("mapping")

    def localize(self) -> list[LiveSweep]:
        """Start the filter, and localize sweeps with start positions that are unknown to it."""
        self._view.say("loading the scan")
        node = self._nodes.start("filter", {"scan_file": str(self._settings.scan)})
        self._until(lambda: self._seen.posteriors, "the filter to load the scan", node)
        mode = SetParameters.Request(parameters=[Parameter("mode", value="localize").to_parameter_msg()])
        self._watcher.call(SetParameters, "simulator/set_parameters", mode)
        self._view.say("localizing")
        return [self._localize(number) for number in range(self._settings.sweeps)]

    def counts(self) -> dict[str, Any]:
        """Update times, lost frames and numbers of messages, from diagnostics after the last sweep."""
        known = self._seen.diagnostics
        known.clear()
        cells = [f"driver: {phalanx}" for phalanx in PHALANGES]
        self._until(lambda: all(name in known for name in ("filter: belief", *cells)), "diagnostics")
        times = {name: float(known["filter: belief"][name]) for name in ("update_median_us", "update_p99_us")}
        dropped = sum(int(known[name]["drops"]) for name in cells)
        return {"frames_dropped": dropped, **times, "messages": dict(self._watcher.received)}

    def _localize(self, number: int) -> LiveSweep:
        settings, seen = self._settings, self._seen
        self._watcher.call(Trigger, "simulator/prepare")
        # A lagging filter would count the motion to the start as part of the sweep.
        ready_ns = time.time_ns()
        self._until(lambda: seen.estimated_ns > ready_ns, "the filter to catch up")
        self._watcher.call(Empty, "filter/reinitialize_global_localization")
        seen.posteriors, seen.truths = [], seen.truths[-1:]
        self._sweep()
        end_ns = seen.truths[-1][0]
        self._until(lambda: seen.estimated_ns >= end_ns, "the last posterior")
        rate = shipped("simulator")["load_cell_rate_hz"]
        contact = contact_of(settings.feature, settings.seed, number, SPEED_MPS, rate)
        sweep = seen.sweep(end_ns, contact)
        self._view.say(describe(number, sweep))
        return sweep

    def _sweep(self) -> None:
        active = self._seen.active
        active.clear()
        self._watcher.call(Trigger, "simulator/sweep")
        self._until(lambda: True in active and not active[-1], "the end of the sweep")

    def _until(self, condition: Callable[[], Any], what: str, node: NodeProcess | None = None) -> None:
        def meanwhile() -> None:
            self._nodes.check()
            self._view.show(self._seen)
            self._view.say(node.last_line if node else "")

        self._watcher.until(condition, what, meanwhile)


def describe(number: int, sweep: LiveSweep) -> str:
    """Outcome of a sweep in one line."""
    outcome = sweep.outcome()
    error_mm, travel_mm = outcome["error_after_contact_mm"], outcome["travel_to_convergence_mm"]
    error = "no contact" if error_mm is None else f"error after contact {error_mm:5.2f} mm"
    convergence = "not converged" if travel_mm is None else f"converged after {travel_mm:4.1f} mm"
    x, y = outcome["start_mm"]
    return f"sweep {number + 1:2d} from ({x:4.1f}, {y:4.1f}) mm: {error}, {convergence}"


def _fresh(settings: DemoSettings) -> Path:
    """Create the output folder without earlier output; returns the folder of the logs."""
    folder = settings.folder
    logs = folder / "log"
    try:
        for path in (logs, folder / "bag", folder / "scan"):
            shutil.rmtree(path, ignore_errors=True)
        for path in (*folder.glob("*.png"), folder / "summary.json"):
            path.unlink(missing_ok=True)
        logs.mkdir(parents=True)
    except OSError as error:
        raise LiveError(f"{folder}: expected a writable folder, {error.strerror}") from None
    return logs
