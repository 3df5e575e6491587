"""Commands and nodes as processes that are always ended."""

import contextlib
import os
import re
import signal
import subprocess
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from support.forked_nodes import ForkedNode
from support.waiting import PATIENCE_S, Deadline, children, wait_until

from tactile_localizer.demo import nodes
from tactile_localizer.ros.base.child_process import end_with_parent


class Process:
    """A running command whose output (both streams) is collected line by line.

    Parameters
    ----------
    command : program and arguments
    environment : environment variables in addition to those of this process
    forked : whether to fork a node from a server instead of starting its executable
    """

    def __init__(
        self,
        command: Sequence[str | Path],
        environment: Mapping[str, str] | None = None,
        forked: bool = False,
    ) -> None:
        self.command = [str(part) for part in command]
        self.lines: list[str] = []
        self._popen: Any
        if forked:
            self._popen = ForkedNode(Path(self.command[0]).name, self.command[1:], environment or {})
        else:
            self._popen = subprocess.Popen(
                self.command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                env={**os.environ, "PYTHONUNBUFFERED": "1", **(environment or {})},
                start_new_session=True,
                preexec_fn=end_with_parent,  # noqa: PLW1509 - one system call, no lock
            )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._popen.stdout is not None
        for line in self._popen.stdout:
            self.lines.append(line.rstrip("\n"))

    @property
    def pid(self) -> int:
        return int(self._popen.pid)

    @property
    def output(self) -> str:
        """The output so far."""
        return "\n".join(self.lines)

    @property
    def running(self) -> bool:
        return bool(self._popen.poll() is None)

    def wait_for_line(self, pattern: str, timeout_s: float = PATIENCE_S, after: int = 0) -> str:
        """Wait for the first line that matches the regular expression ``pattern``.

        The first ``after`` lines do not count.
        """

        def found() -> str | None:
            ended = not self.running and not self._reader.is_alive()
            line = next((line for line in self.lines[after:] if re.search(pattern, line)), None)
            status = self._popen.returncode
            assert line is not None or not ended, f"it ended with status {status} before /{pattern}/"
            return line

        try:
            return wait_until(found, f"/{pattern}/", timeout_s)
        except AssertionError as error:
            raise type(error)(f"{self.command[0]}: {error}; it printed:\n{self.output}") from None

    def wait(self, timeout_s: float = PATIENCE_S) -> int:
        """The exit status of a process that ends by itself."""
        deadline = Deadline(f"the end of {self.command[0]}", timeout_s)
        try:
            status: int = self._popen.wait(timeout_s)
        except subprocess.TimeoutExpired:
            raise deadline.failure() from None
        self._reader.join(5)
        return status

    def stop(self, sig: signal.Signals = signal.SIGINT, timeout_s: float = 30.0) -> int:
        """Send a signal and return the exit status; fails if the process does not end in time."""
        if self.running:
            self._popen.send_signal(sig)
        return self.wait(timeout_s)

    def kill(self) -> None:
        """Kill the process and its children; without effect if they have ended."""
        for pid in (self.pid, *children(self.pid)):
            for kill in (os.killpg, os.kill):  # a process that has just been forked leads no group yet
                with contextlib.suppress(ProcessLookupError):
                    kill(pid, signal.SIGKILL)
        self._popen.wait(10)
        self._reader.join(5)
        if self._popen.stdout is not None:
            self._popen.stdout.close()


def node_command(
    name: str,
    parameters: Mapping[str, Any] | None = None,
    remaps: Mapping[str, str] | None = None,
    namespace: str | None = None,
    parameter_files: Sequence[Path] = (),
) -> list[str]:
    """Command line of an installed node, with names that are remapped."""
    names = ({"__ns": namespace} if namespace else {}) | dict(remaps or {})
    remapped = [word for source, target in names.items() for word in ("-r", f"{source}:={target}")]
    return nodes.node_command(name, parameters or {}, parameter_files) + remapped
