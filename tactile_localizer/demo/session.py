"""A session of all nodes, recorded in a bag: training sweeps, then sweeps to localize."""

from __future__ import annotations

import contextlib
import shutil
import signal
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.srv import SetParameters
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rosbags.interfaces import Connection
from rosbags.rosbag2 import StoragePlugin, Writer, WriterError
from std_msgs.msg import Bool
from std_srvs.srv import Empty, Trigger

from tactile_localizer.demo.nodes import Nodes, own_domain
from tactile_localizer.errors import LiveError
from tactile_localizer.io.bags.reader import typestore
from tactile_localizer.msg import Posterior, ScanStatus, StrainVectors
from tactile_localizer.resources import resource_path
from tactile_localizer.ros.conversions import to_ns
from tactile_localizer.sim.scan import TRAINING_SWEEPS

SCAN_SWEEPS = 2 * TRAINING_SWEEPS
"""Number of training sweeps: two along each line, so that the noise between sweeps can be learned."""

_TIMEOUT_S = 120.0
"""Time limit for each step: a start, a sweep, the loading of the scan, s."""
_POLL_S = 0.02
_DEPTH = 10_000
"""Depth of the queues: on a busy machine the recording may lag by seconds."""
_STRAIN = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)

TOPICS: dict[str, Any] = {
    "/strain": StrainVectors,
    "/palm_pose": PoseStamped,
    "/simulator/ground_truth": PoseStamped,
    "/simulator/sweep_active": Bool,
    "/mapping/status": ScanStatus,
    "/filter/posterior": Posterior,
    "/diagnostics": DiagnosticArray,
}
"""Message types of the recorded topics."""


class Operator:
    """A node that receives :data:`TOPICS`, and calls services of the others.

    Signals to end raise :class:`KeyboardInterrupt` in :meth:`until` only: elsewhere it would interrupt rclpy,
    or the end of other processes.

    Parameters
    ----------
    record : called with the topic of each message, and with the message, serialised in CDR
    check : called often while something is waited for

    Attributes
    ----------
    newest : newest message by topic, and newest diagnostic status by name
    """

    def __init__(self, record: Callable[[str, bytes], None], check: Callable[[], None]) -> None:
        self._record, self._interrupted = record, threading.Event()
        self._handlers = {
            number: signal.signal(number, lambda *_: self._interrupted.set())
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
        silent = SubscriptionEventCallbacks(use_default_callbacks=False)
        for topic, kind in TOPICS.items():
            quality = _STRAIN if kind is StrainVectors else _DEPTH
            receive = partial(self._on_message, topic)
            self._node.create_subscription(kind, topic, receive, quality, event_callbacks=silent, raw=True)

    def close(self) -> None:
        """Leave the ROS graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown()
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def _on_message(self, topic: str, raw: bytes) -> None:
        self._record(topic, raw)
        message = self.newest[topic] = deserialize_message(raw, TOPICS[topic])
        if topic == "/diagnostics":
            self.newest |= {status.name: status for status in message.status}

    def until(self, condition: Callable[[], Any], what: str) -> None:
        """Receive messages until ``condition`` is true.

        Raises
        ------
        LiveError
            It is not true in time.
        KeyboardInterrupt
            The process was asked to end.
        """
        deadline = time.monotonic() + _TIMEOUT_S
        while not condition():
            if self._interrupted.is_set():
                raise KeyboardInterrupt
            if time.monotonic() > deadline:
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

    def sweep(self) -> None:
        """Let the hand make the sweep that it is prepared for."""
        self.newest["/simulator/sweep_active"] = Bool(data=True)
        self.call(Trigger, "simulator/sweep")
        self.until(lambda: not self.newest["/simulator/sweep_active"].data, "the end of a sweep")

    def estimate(self) -> Posterior:
        """The first estimate of strain that is measured from now on."""
        now_ns, topic = time.time_ns(), "/filter/posterior"
        self.until(lambda: to_ns(self.newest[topic].header.stamp) > now_ns, "an estimate")
        return self.newest[topic]

    def values(self, name: str) -> dict[str, str]:
        """Values of a diagnostic status that is published from now on."""
        self.newest.pop(name, None)
        self.until(lambda: name in self.newest, f"status {name!r} of /diagnostics")
        return {value.key: value.value for value in self.newest[name].values}


def record_session(
    feature: str, folder: Path, seed: int, speed: float, sweeps: int, say: Callable[[str], None]
) -> int:
    """Scan a simulated feature and localize on the scan, with all nodes; returns the frames dropped.

    Writes ``scan``, ``bag`` and ``log`` in place of earlier ones.

    Parameters
    ----------
    feature : feature in the simulated material
    folder : folder of the output
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
    try:
        for path in (logs, scan, folder / "bag"):
            shutil.rmtree(path, ignore_errors=True)
        logs.mkdir(parents=True)
        writer = Writer(folder / "bag", version=9, storage_plugin=StoragePlugin.MCAP)
    except (OSError, WriterError) as error:
        raise LiveError(f"{folder}: expected a writable folder, {error}") from None
    connections: dict[str, Connection] = {}

    def record(topic: str, raw: bytes) -> None:
        writer.write(connections[topic], time.time_ns(), raw)

    with (
        own_domain() as port,
        writer,
        contextlib.closing(Nodes(logs)) as nodes,
        contextlib.closing(Operator(record, nodes.check)) as operator,
    ):
        for topic, kind in TOPICS.items():
            name = f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
            connections[topic] = writer.add_connection(topic, name, typestore=store)
        say("starting simulator, driver and mapping")
        bus = {"interface": "udp_multicast", "channel": "239.74.163.2", "bus_options": [f"port={port}"]}
        nodes.start("simulator", {**bus, "feature": feature, "seed": seed, "speed": speed})
        late = {"period_s": 1.0, "max_age_s": 60.0}  # frames of a busy machine are late, none is lost
        nodes.start("driver", {**bus, **late, "tare_file": logs / "tare.yaml"})
        nodes.start(
            "mapping", {"scan_file": scan, "scene_file": resource_path(f"config/scenes/{feature}.yaml")}
        )
        operator.until(lambda: operator.newest["/strain"].strain, "strain")
        operator.until(lambda: int(operator.values("mapping: scan")["poses"]), "poses in the mapping")
        say(f"scanning: {SCAN_SWEEPS} sweeps, two along each line")
        for _ in range(SCAN_SWEEPS):
            operator.call(Trigger, "simulator/prepare")
            operator.call(Trigger, "mapping/start_sweep")
            operator.sweep()
            operator.call(Trigger, "mapping/end_sweep")
        say("loading the scan")
        nodes.start("filter", {"scan_file": scan})
        operator.estimate()
        mode = rclpy.Parameter("mode", value="localize").to_parameter_msg()
        operator.call(SetParameters, "simulator/set_parameters", SetParameters.Request(parameters=[mode]))
        for number in range(1, sweeps + 1):
            operator.call(Trigger, "simulator/prepare")
            operator.estimate()  # a filter that lags would count the motion to the start as part of the sweep
            operator.call(Empty, "filter/reinitialize_global_localization")
            operator.sweep()
            say(f"sweep {number:2}: {operator.estimate().reason}")
        return sum(int(operator.values(f"driver: {name}")["drops"]) for name in ("index", "middle"))
