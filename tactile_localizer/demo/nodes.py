"""Installed nodes as processes in a ROS domain of their own, for the demonstration and for tests."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import yaml

from tactile_localizer.errors import LiveError
from tactile_localizer.resources import resource_path
from tactile_localizer.ros.base.child_process import end_with_parent

_DOMAINS = range(1, 100)
"""Domain ids whose UDP ports are below the ephemeral ports."""
_FIRST_CAN_PORT = 43200
"""UDP port of the simulated CAN bus of domain 0; udp_multicast separates buses by port only."""
_STOP_TIMEOUT_S = 5.0
"""Time for a node to stop after each signal, s."""
_TAIL_BYTES = 4096
"""Bytes at the end of a log in which the last line is searched."""


@dataclass(frozen=True)
class Domain:
    """ROS domain and CAN port of one run.

    Parameters
    ----------
    number : ROS domain id
    can_port : UDP port of the simulated CAN bus
    """

    number: int
    can_port: int

    @property
    def environment(self) -> dict[str, str]:
        """Environment variables for the processes of the run; discovery is limited to this machine."""
        return {"ROS_DOMAIN_ID": str(self.number), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}

    @property
    def bus(self) -> dict[str, Any]:
        """Parameters of driver and simulator for the simulated CAN bus."""
        options = [f"port={self.can_port}"]
        return {"interface": "udp_multicast", "channel": "239.74.163.2", "bus_options": options}


@contextmanager
def own_domain() -> Iterator[Domain]:
    """Context that reserves a domain and its CAN port.

    A process owns both while it is bound to the TCP port with the number of the CAN port.

    Raises
    ------
    LiveError
        All domains are in use.
    """
    for i in _DOMAINS:
        number = _DOMAINS[(os.getpid() + i) % len(_DOMAINS)]
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as claim:
            try:
                claim.bind(("127.0.0.1", _FIRST_CAN_PORT + number))
            except OSError:
                continue
            yield Domain(number, _FIRST_CAN_PORT + number)
            return
    raise LiveError("ROS_DOMAIN_ID: expected a free domain from 1 to 99, all are in use")


class NodeProcess:
    """A running node, with its log in a file.

    Parameters
    ----------
    name : name of the node and of its files; the executable is ``{name}_node``
    parameters : parameters by name
    folder : folder of its parameter file and its log
    environment : environment variables in addition to those of this process
    """

    def __init__(
        self, name: str, parameters: Mapping[str, Any], folder: Path, environment: Mapping[str, str]
    ) -> None:
        self.name = name
        self.log = folder / f"{name}.log"
        file = folder / f"{name}.yaml"
        file.write_text(yaml.safe_dump({"/**": {"ros__parameters": dict(parameters)}}), encoding="utf-8")
        command = [str(node_executable(f"{name}_node")), "--ros-args", "--params-file", str(file)]
        own = {"PYTHONUNBUFFERED": "1", "ROS_LOG_DIR": str(folder / "ros")}
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env={**os.environ, **own, **environment},
                start_new_session=True,  # Ctrl-C reaches only this process
                preexec_fn=end_with_parent,  # noqa: PLW1509 - one system call, no lock
            )

    @property
    def last_line(self) -> str:
        """Last line of the log, without the logger's prefix."""
        with self.log.open("rb") as log:
            log.seek(max(0, self.log.stat().st_size - _TAIL_BYTES))
            lines = log.read().decode(errors="replace").strip().splitlines()
        return lines[-1].rpartition("]: ")[2] if lines else ""

    def stop(self) -> int:
        """Stop the process by SIGINT, then SIGTERM, then SIGKILL; returns its exit status."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            self.process.send_signal(number)
            with contextlib.suppress(subprocess.TimeoutExpired):
                return self.process.wait(_STOP_TIMEOUT_S)
        return self.process.wait()


class Nodes:
    """Nodes of one run; a context manager that stops them at its end.

    Parameters
    ----------
    folder : folder of parameter files and logs
    environment : environment variables in addition to those of this process
    """

    def __init__(self, folder: Path, environment: Mapping[str, str]) -> None:
        self._folder, self._environment = folder, environment
        self._running: dict[str, NodeProcess] = {}

    def __enter__(self) -> Nodes:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for node in self._running.values():
            node.process.send_signal(signal.SIGINT)  # to all first, so that they stop in parallel
        for node in self._running.values():
            node.stop()

    def start(self, name: str, parameters: Mapping[str, Any]) -> NodeProcess:
        """Start an installed node with the parameters of its shipped file, and others."""
        node = NodeProcess(name, {**shipped(name), **parameters}, self._folder, self._environment)
        self._running[name] = node
        return node

    def stop(self, name: str) -> None:
        """Stop one node.

        Raises
        ------
        LiveError
            Its exit status is not 0.
        """
        node = self._running.pop(name)
        if status := node.stop():
            raise LiveError(f"{name}: expected exit status 0, got {status}: {node.last_line}")

    def check(self) -> None:
        """Require that all nodes are running.

        Raises
        ------
        LiveError
            A node has ended.
        """
        for node in self._running.values():
            if node.process.poll() is not None:
                raise LiveError(f"{node.name}: expected it to run, it ended: {node.last_line} ({node.log})")


def shipped(name: str) -> dict[str, Any]:
    """Parameters from the shipped parameter file of a node."""
    text = resource_path(f"config/{name}.yaml").read_text(encoding="utf-8")
    return dict(yaml.safe_load(text)["/**"]["ros__parameters"])


def node_executable(name: str) -> Path:
    """Path of an installed node.

    Raises
    ------
    LiveError
        The workspace is not built, or not sourced.
    """
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        path = Path(prefix, "lib", "tactile_localizer", name)
        if path.exists():
            return path
    raise LiveError(
        f"{name}: expected it below AMENT_PREFIX_PATH, found none; build and source the workspace"
    )
