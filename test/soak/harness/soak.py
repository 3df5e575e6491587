"""The soak: all nodes run while faults are injected one after the other, and invariants are checked."""

from __future__ import annotations

import math
import os
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped

from harness.belief_watch import BeliefWatch
from harness.faults import CAN_BUS, FAULTS, INPUTS, STATUSES, Fault
from harness.memory import Memory, resident_bytes
from harness.patience import Patience
from harness.relay import SENT, Relay
from harness.reports import Reports
from harness.soak_result import Injection, SoakResult
from harness.sweeping import RECORDED_EVERY, Sweeping
from harness.system import System
from tactile_localizer.demo.domain import Domain, own_domain
from tactile_localizer.demo.processes import NodeProcess, NodeProcesses, shipped
from tactile_localizer.demo.watcher import Watcher
from tactile_localizer.errors import LiveError
from tactile_localizer.io.can.bus import BusSettings, open_bus
from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import resource_path
from tactile_localizer.sim import simulate_scan

RECOVERY_LIMIT_S = 20.0
"""Longest recovery after a fault, s."""

_LAG_LIMIT_S = 1.0
_ROUNDS_OF_WARM_UP = 2
_SWEEPS_OF_WARM_UP = 2 * RECORDED_EVERY
_STARTUP_S = 90.0
_POLL_S = 0.05
_SAMPLE_S = 1.0
_HOLD_S = (0.3, 2.0)
_IN_FLIGHT_S = 0.3
"""Strain measured before a fault may be published a little later, s."""

_SCANNED, _OTHER, _BROKEN = "bump", "snap", "broken.db"
_SIMULATED = {"mode": "localize", "speed": 4.0, "load_cell_rate_hz": 20.0, "pose_rate_hz": 15.0}


@dataclass(frozen=True)
class SoakSettings:
    """Settings of a soak.

    Parameters
    ----------
    folder : output folder; the output of an earlier soak is replaced
    duration_s : time after which no further fault is injected
    seed : seed of the order and duration of the faults, and of the simulated hand
    faults : faults to inject, repeatedly, each round in another order
    """

    folder: Path
    duration_s: float
    seed: int = 1
    faults: Sequence[Fault] = FAULTS


class View(Protocol):
    """Shows the progress of the soak."""

    def phase(self, text: str) -> None:
        """Called at the beginning of a phase."""

    def injection(self, one: Injection) -> None:
        """Called at the end of a fault."""


def run_soak(settings: SoakSettings, view: View) -> SoakResult:
    """Start the nodes, inject faults for the given duration, stop the nodes.

    Raises
    ------
    LiveError
        The nodes did not start.
    """
    logs, scans = settings.folder / "log", settings.folder / "scans"
    _make_empty(logs, scans)
    _write_scans(scans, settings.seed)
    with own_domain() as domain, ExitStack() as stack:
        os.environ.update(domain.environment)
        watcher = stack.enter_context(Watcher(domain.number))
        relay, reports = Relay(watcher), Reports(watcher)
        belief = BeliefWatch(watcher, relay)
        processes = stack.enter_context(NodeProcesses(logs, domain.environment))
        view.phase("starting simulator, driver, mapping and filter")
        nodes = _start(processes, settings, domain)
        options = {"port": domain.can_port, "hop_limit": 0}
        bus = open_bus(BusSettings("udp_multicast", "239.74.163.2", options))
        stack.callback(bus.shutdown)
        seeds = watcher.publisher(PoseWithCovarianceStamped, "filter/initial_pose", 10)
        names = f"{_SCANNED}.db", f"{_OTHER}.db", _BROKEN
        system = System(nodes, reports, watcher, relay, bus, seeds, belief, names)
        sweeping = Sweeping(watcher, relay, belief)
        soak = _Soak(settings, view, system, processes, sweeping)
        soak.run()
    soak.result.tracebacks = [log.name for log in logs.glob("*.log") if "Traceback" in log.read_text()]
    return soak.result


class _Soak:
    """Injects faults and checks the invariants.

    Attributes
    ----------
    result : result so far
    """

    def __init__(
        self,
        settings: SoakSettings,
        view: View,
        system: System,
        processes: NodeProcesses,
        sweeping: Sweeping,
    ) -> None:
        self.result = SoakResult()
        self._settings, self._view, self._system = settings, view, system
        self._processes, self._sweeping = processes, sweeping
        self._rng = np.random.default_rng(settings.seed)
        self._sampled_s = 0.0
        self._pairs_when_warm = 0

    def run(self) -> None:
        """Fill the result."""
        trouble = self._wait_for_recovery(time.monotonic(), _STARTUP_S)
        if trouble:
            raise LiveError(f"waited {_STARTUP_S:g} s for the nodes: {trouble}")
        self._begun_s = time.monotonic()
        self._view.phase("injecting faults")
        with self._sweeping:
            try:
                for fault in self._faults():
                    self.result.injections.append(self._inject(fault))
                    self._view.injection(self.result.injections[-1])
            except LiveError as error:  # a process has ended, or the watcher
                self.result.ended = str(error)
        belief = self._system.belief
        self.result.sweeps, self.result.judged = self._sweeping.done, belief.judged
        self.result.recorded_pairs = self._sweeping.pairs - self._pairs_when_warm
        self.result.converged, self.result.wrong = belief.converged, dict(belief.wrong)
        self.result.false_sweeps, self.result.errors_m = list(belief.false_sweeps), list(belief.errors_m)

    def _faults(self) -> Iterator[Fault]:
        """The faults in random order, repeatedly; memory is compared after the warm-up."""
        number = 0
        while True:
            warm = number >= _ROUNDS_OF_WARM_UP and self._sweeping.done >= _SWEEPS_OF_WARM_UP
            if warm and not self.result.is_warm:
                self.result.is_warm = True
                self._pairs_when_warm = self._sweeping.pairs
                for memory in self.result.memory.values():
                    memory.warm_up = len(memory.samples)
            for index in self._rng.permutation(len(self._settings.faults)):
                if self._elapsed_s > self._settings.duration_s:
                    return
                yield self._settings.faults[index]
            number += 1

    @property
    def _elapsed_s(self) -> float:
        return time.monotonic() - self._begun_s

    def _inject(self, fault: Fault) -> Injection:
        """Inject a fault, wait until it is reported, hold it, end it, and wait for the recovery."""
        one = Injection(fault.name, self._elapsed_s)
        system, trouble = self._system, []
        if fault.misleads:
            system.belief.misled = fault.name
        system.reports.forget()
        begun_s = time.monotonic()
        try:
            fault.acts.begin(system)
            done_s = time.monotonic()
            if self._until(lambda: fault.shows(system), fault.within_s):
                one.reported_s = time.monotonic() - begun_s
            else:
                trouble.append(f"not reported within {fault.within_s:g} s")
            held_until_s = time.monotonic() + self._rng.uniform(*_HOLD_S)
            self._until(lambda: time.monotonic() > held_until_s, math.inf)
            # A position with a stamp after the beginning of the fault would be extrapolated.
            since_s = time.monotonic() - done_s
            if fault.starves and system.reports.lag_s(system.relay.clock_ns) < since_s - _IN_FLIGHT_S:
                trouble.append("an extrapolated position was published")
        finally:
            fault.acts.end(system)
            system.belief.misled = ""
        ended_s = time.monotonic()
        if problem := self._wait_for_recovery(ended_s, RECOVERY_LIMIT_S):
            trouble.append(f"not recovered: {problem}")
        else:
            one.recovered_s = time.monotonic() - ended_s
        one.trouble = "; ".join(trouble)
        return one

    def _wait_for_recovery(self, since_s: float, timeout_s: float) -> str:
        """Wait until all nodes report OK; returns the first problem if that takes too long."""
        reports, relay = self._system.reports, self._system.relay

        def trouble() -> str:
            if problem := reports.first_not_ok(STATUSES, since_s):
                return problem
            lag_s = reports.lag_s(relay.clock_ns)
            return f"posteriors are {lag_s:.1f} s behind" if lag_s > _LAG_LIMIT_S else ""

        if self._until(lambda: not trouble(), timeout_s):
            self.result.lag_s = max(self.result.lag_s, reports.lag_s(relay.clock_ns))
            return ""
        return trouble()

    def _until(self, condition: Callable[[], Any], timeout_s: float) -> bool:
        """Check the invariants until a condition is true; returns whether it became true in time.

        Time for which a process waited for a CPU is not counted.
        """
        pids = [os.getpid(), *(node.pid for node in self._system.nodes.values())]
        patience = Patience(timeout_s, pids)
        while not condition():
            if patience.is_over:
                return False
            self._watch()
            time.sleep(_POLL_S)
        self.result.late += patience.is_late
        return True

    def _watch(self) -> None:
        """Raise a :class:`LiveError` if a process has ended; sample memory and queues."""
        self._processes.check()
        self._system.watcher.check()
        now_s = time.monotonic()
        if now_s - self._sampled_s < _SAMPLE_S:
            return
        self._sampled_s = now_s
        result, newest = self.result, self._system.reports.newest
        for name, node in self._system.nodes.items():
            result.memory.setdefault(name, Memory()).samples.append(resident_bytes(node.pid))
        if INPUTS in newest:
            result.waiting_s = max(result.waiting_s, float(newest[INPUTS].values["waiting_s"]))
        if CAN_BUS in newest:
            result.queue_bytes = max(result.queue_bytes, int(newest[CAN_BUS].values["queue_bytes"]))


def _start(processes: NodeProcesses, settings: SoakSettings, domain: Domain) -> dict[str, NodeProcess]:
    """Start the four nodes, with the relay between sensors and the rest."""
    bus = {
        "interface": "udp_multicast",
        "channel": "239.74.163.2",
        "bus_options": [f"port={domain.can_port}"],
    }
    folder = settings.folder
    scene = str(resource_path(f"config/scenes/{_SCANNED}.yaml"))
    simulated = _SIMULATED | {"feature": _SCANNED, "seed": settings.seed + 1}
    scans = str(folder / "scans")
    return {
        "simulator": processes.start(
            "simulator",
            "simulator_node",
            shipped("simulator") | simulated | bus,
            {"palm_pose": SENT["palm_pose"]},
        ),
        "driver": processes.start(
            "driver",
            "driver_node",
            shipped("driver") | bus | {"tare_file": str(folder / "tare.yaml")},
            {"strain": SENT["strain"]},
        ),
        "mapping": processes.start(
            "mapping",
            "mapping_node",
            shipped("mapping") | {"scan_file": str(folder / "scans" / "recorded.db"), "scene_file": scene},
        ),
        "filter": processes.start(
            "filter",
            "filter_node",
            shipped("filter") | {"scan_file": f"{scans}/{_SCANNED}.db", "scan_directory": scans},
        ),
    }


def _write_scans(folder: Path, seed: int) -> None:
    """Write a scan of the feature, one of another feature, and a file that is not a scan."""
    for feature in (_SCANNED, _OTHER):
        scan = simulate_scan(feature, seed)
        scene = load_scene(resource_path(f"config/scenes/{feature}.yaml"))
        with ScanStore.create(folder / f"{feature}.db", scene) as store:
            for part in scan.slices():
                store.begin_sweep()
                store.append(scan.stamp_ns[part], scan.odometry[part], scan.strain[part])
                store.end_sweep()
    (folder / _BROKEN).write_bytes(b"not a scan " * 1000)


def _make_empty(*folders: Path) -> None:
    try:
        for folder in folders:
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
    except OSError as error:
        raise LiveError(f"{folder}: expected a writable folder, {error.strerror}") from None
