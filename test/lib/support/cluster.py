"""A Dask cluster of processes: a scheduler and workers of one thread, none of which is started again."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from support.waiting import wait_until

from tactile_localizer.io.scans.folder import ScanFolder


class Cluster:
    """The address of the scheduler, and the processes of the workers."""

    def __init__(self, address: str, workers: list[subprocess.Popen[bytes]]) -> None:
        self.address, self.workers = address, workers

    def kill_a_worker(self) -> None:
        """End a worker by a signal that it cannot handle."""
        self.workers[0].kill()
        self.workers[0].wait()


@contextmanager
def cluster_of(workers: int, folder: Path) -> Iterator[Cluster]:
    """Context of a cluster; its processes end with it."""
    from distributed import Client

    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    file = folder / "scheduler.json"
    with ExitStack() as stack:

        def start(module: str, *options: str) -> subprocess.Popen[bytes]:
            command = [sys.executable, "-m", f"distributed.cli.{module}", "--scheduler-file", str(file)]
            process = subprocess.Popen(
                [*command, *options], cwd=folder, env=environment, stderr=subprocess.DEVNULL
            )
            stack.callback(process.wait)
            stack.callback(process.kill)
            return process

        start("dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        wait_until(file.exists, "the file of the scheduler", 300.0)
        options = "--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(folder)
        started = [start("dask_worker", *options) for _ in range(workers)]
        with Client(scheduler_file=str(file), timeout=120, set_as_default=False) as client:
            wait_until(lambda: len(client.scheduler_info()["workers"]) == workers, "the workers", 300.0)
            address = client.scheduler.address
        yield Cluster(address, started)


def answer(value: Any, _progress: Any) -> Any:
    """The value; ``None`` ends the process as a kernel without memory does."""
    if value is None:
        os._exit(1)
    return value


def open_scan(path: str, _progress: Any) -> None:
    """Open a scan."""
    ScanFolder(path)
