"""Fixtures of all tests: repeatable random tests, a separate ROS domain, processes that are always ended."""

import importlib.util
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from support.processes import Process, node_command

from tactile_localizer.demo.nodes import own_domain

settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=50)
settings.load_profile("repeatable")

# Before any test imports rclpy: no other test process and no robot shares the domain.
_CLAIM = ExitStack()
_CAN_PORT = _CLAIM.enter_context(own_domain())
os.environ.setdefault("MPLBACKEND", "Agg")
# Processes started by `make test &` in a script ignore Ctrl-C; those of the tests must not inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)
# Before any test imports numpy: the matrices are small, and threads of BLAS would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")


def _why_no_ros() -> str | None:
    if importlib.util.find_spec("rclpy") is None:
        return "rclpy is not installed: `make test` makes an environment that has it"
    if importlib.util.find_spec("tactile_localizer.msg") is None:
        return "the messages are not built: `make build` builds them"
    return None


def pytest_report_header() -> str | None:
    """Print why tests of nodes are left out."""
    return _why_no_ros()


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Without ROS, leave out the folders whose modules import it."""
    folder = collection_path.relative_to(Path(__file__).parent).parts[:1]
    return (folder in {("demo",), ("launch",), ("ros",), ("soak",)} and bool(_why_no_ros())) or None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if reason := _why_no_ros():
        for item in items:
            if item.get_closest_marker("ros"):
                item.add_marker(pytest.mark.skip(reason=reason))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """With ``--dist loadfile``, share out the figures one by one: they take minutes."""
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return nodeid if nodeid.startswith("test/regression/") else super()._split_scope(nodeid)

    return Scheduling(config, log) if config.getoption("dist") == "loadfile" else None


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print why each test was repeated; pytest-rerunfailures only counts them."""
    for report in terminalreporter.stats.get("rerun", ()):
        terminalreporter.section(f"starved and repeated: {report.nodeid}", sep="-")
        terminalreporter.write_line(report.longreprtext)
        for name, content in report.sections:
            terminalreporter.write_line(f"--- {name}\n{content}")


@pytest.fixture(scope="session", autouse=True)
def _learned_once(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Commands learn from each scan once, until the code that learns changes; see :mod:`support.learned`."""
    from support import learned

    cache = getattr(request.config, "cache", None)  # of all workers; none with -p no:cacheprovider
    name = f"learned-{learned.version()}"
    learned.keep_in(cache.mkdir(name) if cache else tmp_path_factory.mktemp(name))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tactile_localizer.io.scans.learned.learn_model", learned.calibrated_once)
        yield


@pytest.fixture
def data_dir() -> Path:
    """Directory of recorded data sets, from TACTILE_LOCALIZER_DATA."""
    directory = os.environ.get("TACTILE_LOCALIZER_DATA")
    if not directory:
        pytest.skip("TACTILE_LOCALIZER_DATA is not set: no recorded data here")
    return Path(directory)


@pytest.fixture
def simulated_can() -> dict[str, Any]:
    """Interface, channel and port of a simulated CAN bus that no other test process uses."""
    return {"interface": "udp_multicast", "channel": "239.74.163.2", "port": _CAN_PORT}


@pytest.fixture
def bus(simulated_can: dict[str, Any]) -> dict[str, Any]:
    """Parameters of nodes on the simulated CAN bus."""
    interface, channel, port = simulated_can.values()
    return {"interface": interface, "channel": channel, "bus_options": [f"port={port}"]}


@pytest.fixture
def place(bus: dict[str, Any], tmp_path: Path) -> Any:
    """A :class:`support.scenarios.Place`: a scan of the bump, and two simulated buses."""
    from support.scenarios import Place
    from support.sweeps import write_scan

    write_scan(tmp_path / "bump_scan")
    return Place(tmp_path, tmp_path / "bump_scan", [bus, {**bus, "bus_options": [f"port={_CAN_PORT + 100}"]}])


@pytest.fixture
def process() -> Iterator[Callable[..., Process]]:
    """Start a command: ``process([...])`` is a :class:`support.processes.Process`, killed after the test."""
    started: list[Process] = []

    def start(*args: Any, **kwargs: Any) -> Process:
        started.append(Process(*args, **kwargs))
        return started[-1]

    try:
        yield start
    finally:
        for one in reversed(started):
            one.kill()
            print(f"--- {' '.join(one.command)}\n{one.output}")  # pytest shows it when the test has failed


@pytest.fixture
def node_process(process: Callable[..., Process]) -> Callable[..., Process]:
    """Start a node: ``node_process("driver_node", parameters={...})``; see ``node_command``."""
    return lambda *args, **kwargs: process(node_command(*args, **kwargs), forked=True)


@pytest.fixture
def refusal(node_process: Callable[..., Process]) -> Callable[..., list[str]]:
    """Run a node that cannot start: ``refusal("driver_node", parameters)`` returns its output.

    It runs in a separate process: threads left by earlier tests can still write to the output of this one.
    """

    def refused(name: str, parameters: dict[str, Any]) -> list[str]:
        node = node_process(name, parameters)
        assert node.wait() == 2
        return node.lines

    return refused


@pytest.fixture
def probe() -> Iterator[Any]:
    """A :class:`support.probe.Probe`."""
    from support.probe import Probe

    probe = Probe()
    try:
        yield probe
    finally:
        probe.close()
