"""Installed nodes as processes in a ROS domain of their own, for the demonstration and for tests."""

import contextlib
import json
import os
import shutil
import signal
import socket
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from tactile_localizer.errors import LiveError
from tactile_localizer.resources import resource_path
from tactile_localizer.ros.base.child_process import end_with_parent

_DOMAINS = range(1, 100)
"""Domain ids whose UDP ports are below the ephemeral ports."""
_FIRST_CAN_PORT = 43200
"""UDP port of the simulated CAN bus of domain 0; udp_multicast separates buses by port only."""
_PROFILE_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
"""Environment variables that name the profile: Fast DDS 2 reads only the first, and 3 warns of it."""
_FIRST_WITH_FAST_DDS_3 = 9
"""Major version of rmw_fastrtps: 8 in Jazzy, 9 in Kilted."""
_STOP_TIMEOUT_S = 5.0
"""Time for the nodes to stop after each signal, s."""


@contextlib.contextmanager
def own_domain() -> Iterator[int]:
    """Context that reserves a ROS domain on this machine, and yields the UDP port of its simulated CAN bus.

    This process and those that it starts get the domain by their environment, and ``config/fastdds.xml`` if
    they use Fast DDS. The process owns both while it is bound to the TCP port of that number.

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
            os.environ.update(ROS_DOMAIN_ID=str(number), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
            if os.environ.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp").startswith("rmw_fastrtps"):
                use_profile(resource_path("config/fastdds.xml"))  # its own range is this machine, too
                os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SYSTEM_DEFAULT"
            yield _FIRST_CAN_PORT + number
            return
    raise LiveError("ROS_DOMAIN_ID: expected a free domain from 1 to 99, all are in use")


def use_profile(file: Path) -> None:
    """Name the profile of Fast DDS in the environment, by the variable that the installed version reads."""
    about = (prefix / "share/rmw_fastrtps_shared_cpp/package.xml" for prefix in _prefixes())
    versions = (ElementTree.parse(each).findtext("version", "") for each in about if each.is_file())
    major = int(next(versions, "0").partition(".")[0])
    for number, variable in enumerate(_PROFILE_VARIABLES):
        if number == (major >= _FIRST_WITH_FAST_DDS_3):
            os.environ[variable] = str(file)
        else:
            os.environ.pop(variable, None)


def _prefixes() -> list[Path]:
    """Folders in which ROS packages are installed."""
    return [Path(one) for one in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)]


class Nodes:
    """Running nodes, each with its log in a file.

    Parameters
    ----------
    folder : folder of the logs, ``{name}.log``
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._running: dict[Path, subprocess.Popen[bytes]] = {}

    def start(self, name: str, parameters: Mapping[str, Any]) -> None:
        """Start the executable ``{name}_node`` with the parameters of the simulated hand, and others.

        Raises
        ------
        LiveError
            The workspace is not built, or not sourced.
        """
        log, file = self._folder / f"{name}.log", resource_path("config/simulator.yaml")
        with log.open("wb") as output:
            self._running[log] = subprocess.Popen(
                node_command(f"{name}_node", parameters, [file]),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env={**os.environ, "PYTHONUNBUFFERED": "1", "ROS_LOG_DIR": str(self._folder / "ros")},
                start_new_session=True,  # Ctrl-C reaches only this process
                preexec_fn=end_with_parent,  # noqa: PLW1509 - one system call, no lock
            )

    def check(self) -> None:
        """Require that all nodes are running.

        Raises
        ------
        LiveError
            A node has ended.
        """
        for log, process in self._running.items():
            if process.poll() is not None:
                line = log.read_text(errors="replace").strip().rpartition("\n")[2].rpartition("]: ")[2]
                raise LiveError(f"{log.stem}: expected it to run, it ended: {line} ({log})")

    def close(self) -> None:
        """Stop the nodes by SIGINT, then SIGTERM, then SIGKILL."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            for process in self._running.values():
                process.send_signal(number)
            for process in self._running.values():
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(_STOP_TIMEOUT_S)


def node_command(executable: str, parameters: Mapping[str, Any], files: Sequence[Path] = ()) -> list[str]:
    """Command line of an installed node, as ``ros2 run`` would make it.

    Parameters
    ----------
    executable : name of the executable, such as ``driver_node``
    parameters : values by name
    files : parameter files, which ``parameters`` override

    Raises
    ------
    LiveError
        The workspace is not built, or not sourced.
    """
    program = shutil.which(
        executable, path=os.pathsep.join(f"{one}/lib/tactile_localizer" for one in _prefixes())
    )
    if program is None:
        raise LiveError(
            f"{executable}: expected it below AMENT_PREFIX_PATH, found none; build and source the workspace"
        )
    arguments = [program, "--ros-args"]
    for file in files:
        arguments += ["--params-file", str(file)]
    for name, value in parameters.items():
        arguments += ["-p", f"{name}:={json.dumps(value, default=str)}"]
    return arguments
