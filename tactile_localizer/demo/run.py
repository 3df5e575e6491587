"""The demonstration: the nodes scan a simulated feature, then localize new sweeps on the scan."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_srvs.srv import Empty, Trigger

from tactile_localizer.demo.domain import Domain, own_domain
from tactile_localizer.demo.live_sweep import LiveSweep, contact_of
from tactile_localizer.demo.observations import TOPICS, Observations
from tactile_localizer.demo.processes import NodeProcess, NodeProcesses, shipped
from tactile_localizer.demo.watcher import Watcher
from tactile_localizer.errors import LiveError
from tactile_localizer.io.bags.writer import BagWriter
from tactile_localizer.resources import resource_path
from tactile_localizer.sim.scan import TRAINING_SWEEPS
from tactile_localizer.sim.sweep import SPEED_MPS

SCAN_SWEEPS = 2 * TRAINING_SWEEPS
"""Number of training sweeps: two along each line, so that the noise between sweeps can be learned."""

_STARTUP_S = 60.0
_LOADING_S = 120.0
"""Time limits for a response of a node, and for the filter to load the scan, s."""

_POLL_S = 0.02


@dataclass(frozen=True)
class DemoSettings:
    """Settings of the demonstration.

    Parameters
    ----------
    feature : feature in the simulated material
    folder : output folder; the output of an earlier demonstration is replaced
    seed : seed of all random processes
    speed : simulated seconds per second of real time
    sweeps : number of sweeps to localize
    """

    feature: str
    folder: Path
    seed: int = 1
    speed: float = 10.0
    sweeps: int = 18


class View(Protocol):
    """Shows the progress of the demonstration."""

    def phase(self, text: str) -> None:
        """Called at the beginning of a phase."""

    def progress(self, done: int, total: int) -> None:
        """Called with the number of finished sweeps of the phase."""

    def show(self, observations: Observations, received: Mapping[str, int], note: str) -> None:
        """Called often, with the newest observations."""

    def sweep(self, sweep: LiveSweep) -> None:
        """Called with every localized sweep."""


@dataclass(frozen=True)
class DemoResult:
    """Result of the demonstration.

    Parameters
    ----------
    sweeps : localized sweeps
    filter : last diagnostics of the filter's belief, by name
    frames_dropped : number of frames of the load cells that are missing from the strain vectors
    received : number of messages, by topic
    """

    sweeps: list[LiveSweep]
    filter: dict[str, str]
    frames_dropped: int
    received: dict[str, int]


def run_demo(settings: DemoSettings, view: View) -> DemoResult:
    """Start the nodes, scan, localize, stop the nodes.

    Raises
    ------
    LiveError
        A node ended or did not respond.
    """
    logs = _fresh(settings.folder)
    observations = Observations()
    with own_domain() as domain:
        os.environ.update(domain.environment)
        types = {f"/{topic.lstrip('/')}": one.type_name for topic, one in TOPICS.items()}
        with (
            BagWriter(settings.folder / "bag", types) as bag,
            Watcher(domain.number, bag.write) as watcher,
            NodeProcesses(logs, domain.environment) as nodes,
        ):
            for topic, one in TOPICS.items():
                watcher.listen(one.kind, topic, one.quality, observations.callback_for(topic))
            demo = _Demo(settings, view, observations, watcher, nodes, domain)
            demo.start()
            demo.scan()
            sweeps = demo.localize()
            return DemoResult(
                sweeps,
                observations.diagnostics["filter: belief"],
                observations.frames_dropped,
                dict(watcher.received),
            )


class _Demo:
    def __init__(
        self,
        settings: DemoSettings,
        view: View,
        observations: Observations,
        watcher: Watcher,
        nodes: NodeProcesses,
        domain: Domain,
    ) -> None:
        self._settings, self._view, self._observations = settings, view, observations
        self._watcher, self._nodes = watcher, nodes
        self._bus = {
            "interface": "udp_multicast",
            "channel": "239.74.163.2",
            "bus_options": [f"port={domain.can_port}"],
        }
        self._simulator = shipped("simulator") | {
            "feature": settings.feature,
            "seed": settings.seed,
            "speed": settings.speed,
        }
        self._scan_file = settings.folder / "scan.db"

    def start(self) -> None:
        """Start simulator, driver and mapping, and wait for their messages."""
        self._view.phase("starting simulator, driver and mapping")
        self._nodes.start("simulator", "simulator_node", self._simulator | self._bus)
        tare = {"tare_file": str(self._settings.folder / "log" / "tare.yaml")}
        self._nodes.start("driver", "driver_node", shipped("driver") | self._bus | tare)
        scene = resource_path(f"config/scenes/{self._settings.feature}.yaml")
        self._mapping = self._nodes.start(
            "mapping",
            "mapping_node",
            shipped("mapping") | {"scan_file": str(self._scan_file), "scene_file": str(scene)},
        )
        received = self._watcher.received
        self._until(
            lambda: received["strain"] and received["palm_pose"] and received["mapping/status"],
            "strain, palm poses and the status of the mapping node",
            _STARTUP_S,
        )
        # Nodes discover each other independently: what is received here may not reach the mapping node yet.
        self._until(
            lambda: self._observations.is_mapped,
            "the mapping node to receive strain and palm poses",
            _STARTUP_S,
        )

    def scan(self) -> None:
        """Record the training sweeps."""
        self._view.phase("scanning, two sweeps along each line")
        for number in range(SCAN_SWEEPS):
            self._view.progress(number, SCAN_SWEEPS)
            self._ask("simulator/prepare")
            self._ask("mapping/start_sweep")
            self._sweep()
            self._ask("mapping/end_sweep")
        self._view.progress(SCAN_SWEEPS, SCAN_SWEEPS)
        self._nodes.stop(self._mapping)

    def localize(self) -> list[LiveSweep]:
        """Localize sweeps with start positions that are unknown to the filter."""
        self._view.phase("loading the scan")
        parameters = shipped("filter") | {"scan_file": str(self._scan_file)}
        node = self._nodes.start("filter", "filter_node", parameters)
        self._until(lambda: self._observations.posteriors, "the filter", _LOADING_S, node)
        mode = SetParameters.Request(parameters=[Parameter("mode", value="localize").to_parameter_msg()])
        self._watcher.call(SetParameters, "simulator/set_parameters", mode)
        self._view.phase("localizing")
        sweeps: list[LiveSweep] = []
        for number in range(self._settings.sweeps):
            self._view.progress(number, self._settings.sweeps)
            sweeps.append(self._localize_once(number))
            self._view.sweep(sweeps[-1])
        self._wait_for_diagnostics()
        return sweeps

    def _localize_once(self, number: int) -> LiveSweep:
        self._ask("simulator/prepare")
        # A lagging filter would count the motion to the start as part of the sweep.
        ready_ns = time.time_ns()
        self._until(lambda: self._observations.estimated_ns > ready_ns, "the filter to catch up", _STARTUP_S)
        self._watcher.call(Empty, "filter/reinitialize_global_localization")
        self._observations.begin_sweep()
        self._sweep()
        end_ns = self._observations.truths[-1][0]
        self._until(lambda: self._observations.estimated_ns >= end_ns, "the last posterior", _STARTUP_S)
        contact = contact_of(
            self._settings.feature,
            self._settings.seed,
            number,
            self._simulator.get("sweep_speed_mps", SPEED_MPS),
            self._simulator["load_cell_rate_hz"],
        )
        return self._observations.localized_sweep(number, end_ns, contact)

    def _sweep(self) -> None:
        self._observations.active.clear()
        self._ask("simulator/sweep")
        self._until(lambda: self._observations.sweep_is_over, "the end of the sweep", _STARTUP_S)

    def _wait_for_diagnostics(self) -> None:
        """Wait for diagnostics of all nodes that were published after the last sweep."""
        self._observations.diagnostics.clear()
        self._until(lambda: self._observations.is_diagnosed, "diagnostics", _STARTUP_S)

    def _ask(self, service: str) -> None:
        answer = self._watcher.call(Trigger, service)
        if not answer.success:
            raise LiveError(f"service {service}: {answer.message}")

    def _until(
        self, condition: Callable[[], Any], what: str, timeout_s: float, node: NodeProcess | None = None
    ) -> None:
        deadline = time.monotonic() + timeout_s
        while not condition():
            self._nodes.check()
            self._watcher.check()
            if time.monotonic() > deadline:
                raise LiveError(f"waited {timeout_s:g} s for {what}")
            note = "" if node is None else node.last_line
            self._view.show(self._observations, self._watcher.received, note)
            time.sleep(_POLL_S)


def _fresh(folder: Path) -> Path:
    """Create the output folder without earlier output; returns the folder of the logs."""
    logs = folder / "log"
    try:
        for path in (logs, folder / "bag"):
            shutil.rmtree(path, ignore_errors=True)
        for path in (*folder.glob("scan.db*"), *folder.glob("*.png"), folder / "summary.json"):
            path.unlink(missing_ok=True)
        logs.mkdir(parents=True)
    except OSError as error:
        raise LiveError(f"{folder}: expected a writable folder, {error.strerror}") from None
    return logs
