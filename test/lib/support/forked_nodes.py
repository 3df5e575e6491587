"""Nodes forked from a server that has imported them, which saves a second of processor time per start.

The executables themselves run in ``test/integration``, the demo and the soak.
"""

import importlib
import multiprocessing
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from multiprocessing.connection import Connection
from typing import Any

from tactile_localizer.ros.base.child_process import end_with_parent

_CONTEXT = multiprocessing.get_context("forkserver")
_CONTEXT.set_forkserver_preload(
    [f"tactile_localizer.ros.{name}_node" for name in ("adapter", "driver", "filter", "mapping", "simulator")]
)


class ForkedNode:
    """A node in its own process and session, with the part of the interface of ``Popen`` that tests use.

    Parameters
    ----------
    name : module of the node, such as ``driver_node``
    arguments : command line without the executable
    environment : environment variables in addition to those of this process
    """

    def __init__(self, name: str, arguments: Sequence[str], environment: Mapping[str, str]) -> None:
        output, input_ = _CONTEXT.Pipe(duplex=False)
        variables = {**os.environ, **environment}
        self._process = _CONTEXT.Process(target=_run, args=(name, list(arguments), variables, input_))
        self._process.start()
        input_.close()
        self.stdout = os.fdopen(os.dup(output.fileno()), encoding="utf-8", errors="replace")
        output.close()
        assert self._process.pid is not None
        self.pid = self._process.pid

    @property
    def returncode(self) -> int | None:
        """The exit status; negative for a signal, ``None`` while the node runs."""
        return self._process.exitcode

    def poll(self) -> int | None:
        """See ``Popen``."""
        return self.returncode

    def send_signal(self, number: int) -> None:
        """See ``Popen``."""
        os.kill(self.pid, number)

    def wait(self, timeout_s: float) -> int:
        """See ``Popen``."""
        self._process.join(timeout_s)
        if self.returncode is None:
            raise subprocess.TimeoutExpired(f"process {self.pid}", timeout_s)
        return self.returncode


def _run(name: str, arguments: list[str], variables: dict[str, str], output: Connection) -> Any:
    end_with_parent()
    os.setsid()
    os.environ.clear()
    os.environ.update(variables)
    for stream in (1, 2):
        os.dup2(output.fileno(), stream)
    os.close(output.fileno())
    sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr]
    sys.argv = [name, *arguments]
    raise SystemExit(importlib.import_module(f"tactile_localizer.ros.{name}").main())
