"""A session of all nodes, recorded in a bag: training sweeps, then sweeps to localize."""

import contextlib
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.srv import SetParameters
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rosbags.interfaces import Connection
from rosbags.rosbag2 import StoragePlugin, Writer, WriterError
from std_msgs.msg import Bool
from std_srvs.srv import Empty, Trigger

from tactile_localizer.demo.nodes import Nodes, own_domain
from tactile_localizer.errors import LiveError, refusing
from tactile_localizer.io.bags.reader import typestore
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.msg import Posterior, ScanStatus, StrainVectors
from tactile_localizer.resources import resource_path
from tactile_localizer.sim.hand import PHALANGES
from tactile_localizer.sim.scan import TRAINING_SWEEPS
from tactile_localizer.streams.runs import to_ns

SCAN_SWEEPS = 2 * TRAINING_SWEEPS
"""Number of training sweeps: two along each line, so that the noise between sweeps can be learned."""

_TIMEOUT_S = 300.0
"""Time limit for a start, a sweep or loading the scan, counted from the last report of progress, s."""
_POLL_S = 0.02
_SHOWN = 7
"""Number of training sweeps per line of progress."""
_SLOWER = ((2.0, 16.0), (0.1, 4.0))
"""Age on receipt of a message, s, from which the hand is slowed down, and by how much."""
_SLOWEST = 0.5
"""Speed at which poses are 80 ms apart; further apart, positions are not interpolated."""
_DEPTH = 10_000
"""Depth of the queues: on a busy machine the recording may lag by seconds."""
_RELIABLE = "qos_overrides./strain.{}.reliability"
"""Parameter of the reliability of strain, which is best effort by default: a busy machine loses some."""

TOPICS: dict[str, Any] = {
    "/strain": StrainVectors,
    "/palm_pose": PoseStamped,
    "/tactile_simulator/ground_truth": PoseStamped,
    "/tactile_simulator/sweep_active": Bool,
    "/tactile_mapping/status": ScanStatus,
    "/tactile_filter/posterior": Posterior,
    "/diagnostics": DiagnosticArray,
}
"""Message types of the recorded topics."""


class Operator:
    """A node that receives :data:`TOPICS`, and calls services of the others.

    Signals to end raise :class:`KeyboardInterrupt` in :meth:`until` only: elsewhere it would interrupt rclpy,
    or the end of other processes.

    Parameters
    ----------
    record : called with the topic of each message, the message, serialised in CDR, and the time, ns, at which
        it was sent: on a busy machine it is received later, when the hand is elsewhere
    check : called often while something is waited for
    say : called with the progress that a node reports
    speed : of the simulated hand, while no message is late

    Attributes
    ----------
    newest : newest message by topic, and newest diagnostic status by name
    lost : number of strain vectors lost in transport
    """

    def __init__(
        self,
        record: Callable[[str, bytes, int], None],
        check: Callable[[], None],
        say: Callable[[str], None],
        speed: float = 1.0,
    ) -> None:
        self._record, self._say = record, say
        self._interrupted: dict[int, FrameType | None] = {}
        self._handlers = {
            # Python code would be interrupted by the next signal, and that by the next; setdefault is not.
            number: signal.signal(number, self._interrupted.setdefault)
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
            if signal.getsignal(number) is not signal.SIG_IGN  # nohup
        }
        self.newest: dict[str, Any] = {topic: kind() for topic, kind in TOPICS.items()}
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        # Thousands of messages arrive per second; each entity that the executor waits for delays them all.
        self._node, self._executor = (
            Node("operator", start_parameter_services=False),
            SingleThreadedExecutor(),
        )
        self._executor.add_node(self._node)
        self._node.create_timer(_POLL_S, check)
        self._node.create_timer(_POLL_S, self._pace)
        self._speed = self._wanted = speed
        self._set_speed = self._node.create_client(SetParameters, "tactile_simulator/set_parameters")
        self._late_s: dict[str, float] = {}
        self._sequence, self.lost = 0, 0
        self._progress_s = time.monotonic()
        silent = SubscriptionEventCallbacks(use_default_callbacks=False)
        self._subscriptions = {
            topic: self._node.create_subscription(
                kind, topic, partial(self._on_message, topic), _DEPTH, event_callbacks=silent, raw=True
            )
            for topic, kind in TOPICS.items()
        }

    def close(self) -> None:
        """Leave the ROS graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown()
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def _on_message(self, topic: str, raw: bytes, info: Mapping[str, int]) -> None:
        """Record a message, and those behind it: one by one the executor takes ten times as long."""
        subscription, taken = self._subscriptions[topic], [(raw, info)]
        while len(taken) < _DEPTH:
            with subscription.handle:
                following = subscription.handle.take_message(subscription.msg_type, True)
            if following is None:
                break
            taken.append(following)
        for raw, info in taken:
            self._record(topic, raw, info["source_timestamp"])
        message = self.newest[topic] = deserialize_message(taken[-1][0], TOPICS[topic])
        if topic == "/diagnostics":
            for raw, _ in taken:
                for status in deserialize_message(raw, DiagnosticArray).status:
                    self.newest[status.name] = status
                    if any(value.key == "fraction" for value in status.values):
                        self._progress_s = time.monotonic()
                        self._say(status.message)
        if topic in ("/strain", "/palm_pose", "/tactile_mapping/status", "/tactile_filter/posterior"):
            self._late_s[topic] = 1e-9 * (time.time_ns() - to_ns(message.header.stamp))
        if topic == "/strain":
            self._count([raw for raw, _ in taken], message.sequence[0])

    def _count(self, taken: Sequence[bytes], newest: int) -> None:
        """Count the samples of the first load cell that are in none of the strain vectors taken."""
        before = self._sequence or deserialize_message(taken[0], StrainVectors).sequence[0] - 1
        sent, received = newest - before, len(taken)
        if sent != received:  # a vector without its sample has the number of the one before
            numbers = {deserialize_message(raw, StrainVectors).sequence[0] for raw in taken}
            received = len(numbers - {before})
        self.lost += max(sent - received, 0)
        self._sequence = newest

    def _pace(self) -> None:
        """Slow the simulated hand down while the nodes or the recording are late, before a queue is full."""
        late_s = max(self._late_s.values(), default=0.0)
        slower = next((factor for age_s, factor in _SLOWER if late_s > age_s), 1.0)
        wanted = max(self._speed / slower, min(self._speed, _SLOWEST))
        if wanted != self._wanted and self._set_speed.service_is_ready():
            self._wanted = wanted
            self._set_speed.call_async(_request(speed=wanted))

    def until(self, condition: Callable[[], Any], what: str) -> None:
        """Receive messages until ``condition`` is true, for as long as a node reports progress.

        Raises
        ------
        LiveError
            It is not true in time.
        KeyboardInterrupt
            The process was asked to end.
        """
        begun_s = time.monotonic()
        while not condition():
            if self._interrupted:
                raise KeyboardInterrupt
            if time.monotonic() > max(begun_s, self._progress_s) + _TIMEOUT_S:
                raise LiveError(f"waited {_TIMEOUT_S:g} s for {what}")
            self._executor.spin_once()

    def call(self, kind: Any, service: str, request: Any = None) -> None:
        """Call a service.

        Raises
        ------
        LiveError
            The service is not available, does not respond in time, or rejects the request.
        """
        client = self._node.create_client(kind, service)
        self.until(client.service_is_ready, f"service {service}")
        future = client.call_async(request or kind.Request())
        self.until(future.done, f"an answer of service {service}")
        self._node.destroy_client(client)
        response = future.result()
        if not getattr(response, "success", True):
            raise LiveError(f"service {service}: {response.message}")

    def sweep(self, kind: Any, begin: str) -> None:
        """Run one sweep of the simulated hand, after a service call that announces it to a node.

        Afterwards the recording catches up: while the hand is late, there are more poses than strain.

        Parameters
        ----------
        kind, begin : type and name of the service
        """
        self.call(Trigger, "tactile_simulator/prepare")
        self.call(kind, begin)
        self.newest["/tactile_simulator/sweep_active"] = Bool(data=True)
        self.call(Trigger, "tactile_simulator/sweep")
        self.until(lambda: not self.newest["/tactile_simulator/sweep_active"].data, "the end of a sweep")
        for recorded in ("/palm_pose", "/tactile_simulator/ground_truth"):
            self.present(recorded)

    def present(self, topic: str) -> Any:
        """The first message stamped with strain that is measured from now on."""
        now_ns = time.time_ns()
        self.until(lambda: to_ns(self.newest[topic].header.stamp) > now_ns, f"{topic} of the present")
        return self.newest[topic]

    def values(self, name: str) -> dict[str, str]:
        """Values of a diagnostic status that is published from now on."""
        self.newest.pop(name, None)
        self.until(lambda: name in self.newest, f"status {name!r} of /diagnostics")
        return {value.key: value.value for value in self.newest[name].values}


def record_session(
    feature: str, folder: Path, seed: int, speed: float, sweeps: int, say: Callable[[str], None]
) -> int:
    """Scan a simulated feature and localize on the scan, with all nodes; returns how many frames were lost.

    Those are the frames that the driver missed and the strain vectors that the recording missed, from the
    first sweep on. Writes ``scan``, ``bag`` and ``log``.

    Parameters
    ----------
    feature : feature in the simulated material
    folder : folder of the output, with none of these
    seed : seed of all random numbers
    speed : simulated seconds per second of real time
    sweeps : number of sweeps to localize
    say : called with one line per step

    Raises
    ------
    LiveError
        A node ended or did not respond, or the folder cannot be written.
    KeyboardInterrupt
        The process was asked to end.
    """
    logs, scan, store = folder / "log", folder / "scan", typestore()
    with refusing(f"{folder}: expected a writable folder", LiveError, OSError, WriterError):
        logs.mkdir(parents=True, exist_ok=True)
        writer = Writer(folder / "bag", version=9, storage_plugin=StoragePlugin.MCAP)
    connections: dict[str, Connection] = {}

    def record(topic: str, raw: bytes, sent_ns: int) -> None:
        writer.write(connections[topic], sent_ns, raw)

    with (
        own_domain() as port,
        writer,
        contextlib.closing(Nodes(logs)) as nodes,
        contextlib.closing(Operator(record, nodes.check, say, speed)) as operator,
    ):
        for topic, kind in TOPICS.items():
            name = f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
            connections[topic] = writer.add_connection(topic, name, typestore=store)
        say("starting simulator, driver and mapping")
        bus = {"interface": "udp_multicast", "channel": "239.74.163.2", "bus_options": [f"port={port}"]}
        nodes.start("simulator", {**bus, "feature": feature, "seed": seed, "speed": speed})
        late = {"period_s": 1.0, "max_age_s": 60.0}  # frames of a busy machine are late, none is lost
        sent = {_RELIABLE.format("publisher"): "reliable", "qos_overrides./strain.publisher.depth": _DEPTH}
        nodes.start("driver", {**bus, **late, **sent, "tare_file": logs / "tare.yaml"})
        received = {_RELIABLE.format("subscription"): "reliable", "queue_depth": _DEPTH, "patience_s": 60.0}
        received["scan_file"] = scan
        nodes.start("mapping", {**received, "scene_file": resource_path(f"config/scenes/{feature}.yaml")})
        operator.until(lambda: operator.newest["/strain"].strain, "strain")
        operator.until(lambda: int(operator.values("tactile_mapping: scan")["poses"]), "poses in the mapping")
        dropped, operator.lost = _dropped(operator), 0
        say(f"scanning: {SCAN_SWEEPS} sweeps, two along each line")
        for number in range(1, SCAN_SWEEPS + 1):
            operator.sweep(Trigger, "tactile_mapping/start_sweep")
            operator.call(Trigger, "tactile_mapping/end_sweep")
            if number % _SHOWN == 0:
                say(f"scanned {number} of {SCAN_SWEEPS}")
        require_sweeps(scan, SCAN_SWEEPS)
        say("loading the scan")
        nodes.start("filter", received)
        operator.present("/tactile_filter/posterior")
        operator.call(SetParameters, "tactile_simulator/set_parameters", _request(mode="localize"))
        for number in range(1, sweeps + 1):
            operator.sweep(Empty, "tactile_filter/reinitialize_global_localization")
            say(f"sweep {number:2}: {operator.present('/tactile_filter/posterior').reason}")
        return _dropped(operator) - dropped + operator.lost


def _dropped(operator: Operator) -> int:
    """Frames that the driver has missed since it was started."""
    return sum(int(operator.values(f"tactile_driver: {name}")["drops"]) for name in PHALANGES)


def require_sweeps(scan: Path, count: int) -> None:
    """Require that a scan has a number of sweeps with pairs, and nothing that cannot be used.

    Raises
    ------
    LiveError
        It has others.
    """
    found = ScanFolder(scan).recording()
    if len(found.sweeps) != count or found.notes:
        details = "; ".join([str(len(found.sweeps)), *found.notes])
        raise LiveError(f"{scan}: expected {count} sweeps, found {details}")


def _request(**values: Any) -> SetParameters.Request:
    """Request to set parameters of a node."""
    messages = [rclpy.Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
    return SetParameters.Request(parameters=messages)
