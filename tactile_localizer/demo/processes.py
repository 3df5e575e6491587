"""Installed nodes as processes, with parameters and logs in files."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Any

import yaml

from tactile_localizer.errors import LiveError
from tactile_localizer.resources import resource_path

_STOP_TIMEOUT_S = 5.0
"""Time for a node to stop after each signal, s."""

_TAIL_BYTES = 4096
"""Bytes at the end of a log in which the last line is searched."""


class NodeProcess:
    """A running node.

    Parameters
    ----------
    name : name of the node and of its files
    executable : path of the installed executable
    parameters : parameters by name
    folder : folder of its parameter file and its log
    environment : environment variables in addition to those of this process
    remaps : remapped names
    """

    def __init__(
        self,
        name: str,
        executable: Path,
        parameters: Mapping[str, Any],
        folder: Path,
        environment: Mapping[str, str],
        remaps: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        self.name = name
        self.log = folder / f"{name}.log"
        file = folder / f"{name}.yaml"
        file.write_text(yaml.safe_dump({"/**": {"ros__parameters": dict(parameters)}}), encoding="utf-8")
        command = [str(executable), "--ros-args", "--params-file", str(file)]
        for source, target in remaps.items():
            command += ["-r", f"{source}:={target}"]
        with self.log.open("wb") as log:
            self._popen = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env={
                    **os.environ,
                    "PYTHONUNBUFFERED": "1",
                    "ROS_LOG_DIR": str(folder / "ros"),
                    **environment,
                },
                start_new_session=True,  # Ctrl-C reaches only this process
            )

    @property
    def pid(self) -> int:
        """Process id."""
        return self._popen.pid

    @property
    def running(self) -> bool:
        """Whether the process is running."""
        return self._popen.poll() is None

    @property
    def last_line(self) -> str:
        """Last line of the log, without the logger's prefix."""
        with self.log.open("rb") as log:
            log.seek(max(0, self.log.stat().st_size - _TAIL_BYTES))
            lines = log.read().decode(errors="replace").strip().splitlines()
        return lines[-1].rpartition("]: ")[2] if lines else ""

    def signal(self, number: signal.Signals) -> None:
        """Send a signal if the process is running."""
        if self.running:
            self._popen.send_signal(number)

    def wait(self, timeout_s: float) -> bool:
        """Wait for the process; returns whether it ended in time."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._popen.wait(timeout_s)
        return not self.running

    def stop(self) -> int:
        """Stop the process by SIGINT, then SIGTERM, then SIGKILL; returns its exit status."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            self.signal(number)
            if self.wait(_STOP_TIMEOUT_S):
                break
        return self._popen.returncode


class NodeProcesses:
    """Nodes of one run; a context manager that stops them at its end.

    Parameters
    ----------
    folder : folder of parameter files and logs
    environment : environment variables in addition to those of this process
    """

    def __init__(self, folder: Path, environment: Mapping[str, str]) -> None:
        self._folder = folder
        self._environment = environment
        self._running: list[NodeProcess] = []
        self._starting = ThreadPoolExecutor(max_workers=1)

    def __enter__(self) -> NodeProcesses:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._starting.shutdown()
        # Signal all first, so that they stop in parallel.
        for node in self._running:
            node.signal(signal.SIGINT)
        deadline = time.monotonic() + _STOP_TIMEOUT_S
        for node in self._running:
            node.wait(max(0.0, deadline - time.monotonic()))
        for node in reversed(self._running):
            node.stop()

    def start(
        self,
        name: str,
        executable: str,
        parameters: Mapping[str, Any],
        remaps: Mapping[str, str] = MappingProxyType({}),
    ) -> NodeProcess:
        """Start an installed node."""

        def start() -> NodeProcess:
            path = node_executable(executable)
            node = NodeProcess(name, path, parameters, self._folder, self._environment, remaps)
            self._running.append(node)
            return node

        # Signals interrupt only the main thread: in another one, every process that starts is registered.
        return self._starting.submit(start).result()

    def stop(self, node: NodeProcess) -> None:
        """Stop one node.

        Raises
        ------
        LiveError
            Its exit status is not 0.
        """
        status = node.stop()
        self._running.remove(node)
        if status != 0:
            raise LiveError(f"{node.name}: expected exit status 0, got {status}: {node.last_line}")

    def check(self) -> None:
        """Require that all nodes are running.

        Raises
        ------
        LiveError
            A node has ended.
        """
        for node in self._running:
            if not node.running:
                raise LiveError(f"{node.name}: expected it to run, it ended: {node.last_line} ({node.log})")


def node_executable(name: str) -> Path:
    """Path of an installed node.

    Raises
    ------
    LiveError
        The workspace is not built, or not sourced.
    """
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    for prefix in filter(None, prefixes):
        path = Path(prefix, "lib", "tactile_localizer", name)
        if path.exists():
            return path
    raise LiveError(
        f"{name}: expected it below AMENT_PREFIX_PATH, found none; build and source the workspace"
    )


def shipped(name: str) -> dict[str, Any]:
    """Parameters from the shipped parameter file of a node."""
    text = resource_path(f"config/{name}.yaml").read_text(encoding="utf-8")
    return dict(yaml.safe_load(text)["/**"]["ros__parameters"])
