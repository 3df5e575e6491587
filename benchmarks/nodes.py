"""The package's nodes as processes for the duration of a measurement."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

ROOT = Path(__file__).parent.parent
CHANNEL, PORT = "239.74.163.2", 43190
BUS = {"interface": "udp_multicast", "channel": CHANNEL, "bus_options": f"['port={PORT}']"}
"""Parameters of the simulated bus."""

BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)


class Nodes:
    """Context of processes, ended with the block, and a node ``probe`` in this process that subscribes."""

    def __init__(self) -> None:
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        rclpy.init()
        self.probe = rclpy.create_node("bench")
        # One executor throughout: rclpy.spin_once adds and removes the node for each message.
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.probe)
        self._started: list[subprocess.Popen[str]] = []
        self._sweeping: list[bool] = []

    def __enter__(self) -> Nodes:
        return self

    def __exit__(self, *_: object) -> None:
        for process in reversed(self._started):
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        for process in self._started:
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
        self._executor.shutdown()
        self.probe.destroy_node()
        rclpy.try_shutdown()

    def start(self, *command: str | Path) -> subprocess.Popen[str]:
        """Start a Python program; its standard output can be read."""
        arguments = [sys.executable, *map(str, command)]
        self._started.append(subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True))
        return self._started[-1]

    def start_node(self, name: str, parameters: Mapping[str, Any]) -> subprocess.Popen[str]:
        """Start one of the package's nodes."""
        arguments = [part for key, value in parameters.items() for part in ("-p", f"{key}:={value}")]
        return self.start(ROOT / "scripts" / name, "--ros-args", *arguments)

    def until(self, condition: Callable[[], Any], what: str, timeout_s: float) -> None:
        """Spin until ``condition`` holds; ends the program after the timeout."""
        end_s = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > end_s:
                raise SystemExit(f"waited {timeout_s:g} s for {what}")
            self._executor.spin_once(timeout_sec=0.1)

    def call(self, kind: Any, service: str) -> Any:
        """Response of a service."""
        client = self.probe.create_client(kind, service)
        self.until(client.service_is_ready, f"service {service}", 30)
        future = client.call_async(kind.Request())
        self.until(future.done, f"a response of {service}", 60)
        self.probe.destroy_client(client)
        return future.result()

    def watch_sweeps(self) -> None:
        """Subscribe to the sweeps of the simulated hand, as :meth:`sweep` requires."""
        kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.probe.create_subscription(
            Bool, "simulator/sweep_active", lambda message: self._sweeping.append(message.data), kept
        )

    def sweep(self) -> None:
        """Start the next sweep of the simulated hand and wait for its end."""
        self.call(Trigger, "simulator/prepare")
        self._sweeping.clear()
        self.call(Trigger, "simulator/sweep")
        self.until(lambda: self._sweeping[-2:] == [True, False], "the end of the sweep", 60)


def cpu_s(process: subprocess.Popen[str]) -> float:
    """CPU time of a process, s."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
