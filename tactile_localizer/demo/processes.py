"""Installed nodes as processes of their own, each with its parameters and its log in a file."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Any

import yaml

from tactile_localizer.errors import LiveError
from tactile_localizer.resources import resource_path

_PATIENCE_S = 5.0
_LAST_BYTES = 4096


class NodeProcess:
    """A running node.

    Parameters
    ----------
    name : of the node, and of its files
    executable : path of the installed executable
    parameters : by name
    folder : where its parameters and its log are written
    environment : variables on top of this process's own
    remaps : from name to name
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
        given = folder / f"{name}.yaml"
        given.write_text(yaml.safe_dump({"/**": {"ros__parameters": dict(parameters)}}), encoding="utf-8")
        command = [str(executable), "--ros-args", "--params-file", str(given)]
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
                start_new_session=True,  # an interrupt from the terminal is its owner's, who ends it in order
            )

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._popen.pid

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self._popen.poll() is None

    @property
    def last_line(self) -> str:
        """What it printed last, without the logger's stamps."""
        with self.log.open("rb") as log:
            log.seek(max(0, self.log.stat().st_size - _LAST_BYTES))
            lines = log.read().decode(errors="replace").strip().splitlines()
        return lines[-1].rpartition("]: ")[2] if lines else ""

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal, if it still runs."""
        if self.running:
            self._popen.send_signal(number)

    def wait(self, timeout_s: float) -> bool:
        """Whether it ends in time."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._popen.wait(timeout_s)
        return not self.running

    def stop(self) -> int:
        """End it: asked to first, then made to. Returns its exit status."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            self.signal(number)
            if self.wait(_PATIENCE_S):
                break
        return self._popen.returncode


class NodeProcesses:
    """The nodes of one run; leaving the context ends them, whatever happened.

    Parameters
    ----------
    folder : where parameters and logs are written
    environment : variables on top of this process's own
    """

    def __init__(self, folder: Path, environment: Mapping[str, str]) -> None:
        self._folder = folder
        self._environment = environment
        self._running: list[NodeProcess] = []

    def __enter__(self) -> NodeProcesses:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # All are asked at once, so that ending takes as long as the slowest.
        for node in self._running:
            node.signal(signal.SIGINT)
        deadline = time.monotonic() + _PATIENCE_S
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
        path = node_executable(executable)
        node = NodeProcess(name, path, parameters, self._folder, self._environment, remaps)
        self._running.append(node)
        return node

    def stop(self, node: NodeProcess) -> None:
        """End one of them.

        Raises
        ------
        LiveError
            It did not end well.
        """
        status = node.stop()
        self._running.remove(node)
        if status != 0:
            raise LiveError(f"{node.name}: expected exit status 0, got {status}: {node.last_line}")

    def check(self) -> None:
        """Make sure that all run.

        Raises
        ------
        LiveError
            One has ended.
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
    """A node's parameters as the package ships them."""
    text = resource_path(f"config/{name}.yaml").read_text(encoding="utf-8")
    return dict(yaml.safe_load(text)["/**"]["ros__parameters"])
