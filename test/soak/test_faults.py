"""Faults in the running system: each is reported, and what it caused ends with it.

`make soak MINUTES=30` repeats them for half an hour.
"""

import os
import random
import signal
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from std_msgs.msg import Bool
from std_srvs.srv import Empty
from support.probe import Probe
from support.processes import Process, node_command
from support.scenarios import Place

from tactile_localizer.msg import Posterior
from tactile_localizer.resources import resource_path

_GROWTH_BYTES = 10_000_000
"""Memory that a process may gain after the first round of all faults."""


class System:
    """Simulator, driver and filter as processes, and a probe that watches them."""

    def __init__(self, process: Callable[..., Process], probe: Probe, place: Place) -> None:
        self.probe = probe
        parameters: Mapping[str, dict[str, Any]] = {
            "simulator": {**place.buses[0], "mode": "localize", "speed": 2.0},
            "driver": {**place.buses[0], "tare_file": place.folder / "tare.yaml"},
            "filter": {"scan_file": place.scan_file},
        }
        shipped = resource_path("config/simulator.yaml")
        self.nodes = {
            name: process(node_command(f"{name}_node", own, parameter_files=[shipped]))
            for name, own in parameters.items()
        }
        self.reports = probe.diagnostics()
        self.posteriors: list[Any] = probe.listen(Posterior, "tactile_filter/posterior", 1000)
        self.sweeping: list[Any] = probe.listen(Bool, "tactile_simulator/sweep_active")

    def until_reported(self, name: str, text: str) -> None:
        """Wait for a status whose message contains ``text`` in diagnostics that arrive from now on."""
        self.reports.clear()
        self.probe.until(
            lambda: any(
                one.name == name and text in one.message for array in self.reports for one in array.status
            ),
            f"{name} to report {text!r}",
        )

    def until_recovered(self) -> None:
        """Wait until the inputs are OK and new estimates arrive."""
        self.until_reported("tactile_filter: inputs", "OK")
        self.posteriors.clear()
        self.probe.until(lambda: any(not one.stale for one in self.posteriors), "new estimates")

    def set_fault(self, name: str, value: Any) -> None:
        assert self.probe.set_parameter("tactile_simulator", f"fault.{name}", value).successful

    def change(self, node: str, transition: str) -> None:
        assert self.probe.change(f"tactile_{node}", transition)

    def send(self, node: str, number: signal.Signals) -> None:
        os.kill(self.nodes[node].pid, number)

    def sweep(self) -> bool:
        """Localize a sweep from a uniform belief; returns whether it converged, which it must not at once."""
        self.probe.trigger("tactile_simulator/prepare")
        self.probe.call(Empty, "tactile_filter/reinitialize_global_localization")
        self.sweeping.clear()
        self.posteriors.clear()
        assert self.probe.trigger("tactile_simulator/sweep").success
        self.probe.until(lambda: any(m.data for m in self.sweeping) and not self.sweeping[-1].data, "the end")
        assert not any(one.converged and one.travel < 0.005 for one in self.posteriors)
        return any(one.converged for one in self.posteriors)

    def memory(self) -> dict[str, int]:
        """Resident memory of each process, bytes."""
        pages = {
            name: int(Path(f"/proc/{node.pid}/statm").read_text().split()[1])
            for name, node in self.nodes.items()
        }
        return {name: count * os.sysconf("SC_PAGE_SIZE") for name, count in pages.items()}


@dataclass(frozen=True)
class Fault:
    """A fault: how to cause and to end it, and the status and text that report it."""

    cause: Callable[[System], None]
    end: Callable[[System], None]
    status: str
    text: str


def injected(name: str, value: Any, none: Any) -> tuple[Callable[[System], None], ...]:
    """Cause and end of a fault that the simulator injects."""
    return lambda system: system.set_fault(name, value), lambda system: system.set_fault(name, none)


def frozen(node: str) -> tuple[Callable[[System], None], ...]:
    """Stop and continue a process."""
    return lambda system: system.send(node, signal.SIGSTOP), lambda system: system.send(node, signal.SIGCONT)


def deactivated(node: str) -> tuple[Callable[[System], None], ...]:
    """Deactivate and activate a node."""
    return lambda system: system.change(node, "deactivate"), lambda system: system.change(node, "activate")


FAULTS = {
    "load cell silent": Fault(
        *injected("silent", ["middle"], [""]), "tactile_driver: middle", "stale: no frames"
    ),
    "frames lost": Fault(*injected("drop", 0.1, 0.0), "tactile_driver: middle", "lost"),
    "garbage frames": Fault(*injected("garbage", 0.3, 0.0), "tactile_driver: CAN bus", "discarded frames"),
    "driver frozen": Fault(*frozen("driver"), "tactile_filter: inputs", "no strain"),
    "simulator frozen": Fault(*frozen("simulator"), "tactile_filter: inputs", "no palm_pose"),
    "driver down": Fault(*deactivated("driver"), "tactile_filter: inputs", "no strain"),
}


def test_every_fault_is_reported_and_ends(process: Any, probe: Probe, place: Place) -> None:
    system = System(process, probe, place)
    deadline_s = time.monotonic() + 60.0 * float(os.environ.get("SOAK_MINUTES", "0"))
    names, memory = sorted(FAULTS), {}
    chance = random.Random(1)
    system.until_recovered()
    while True:
        for name in names:
            fault = FAULTS[name]
            fault.cause(system)
            system.until_reported(fault.status, fault.text)
            fault.end(system)
            system.until_recovered()
        assert any(system.sweep() for _ in range(3)), "one sweep of a hundred does not converge"
        memory = memory or system.memory()
        if time.monotonic() >= deadline_s:
            break
        chance.shuffle(names)
    for name, used in system.memory().items():
        assert used < memory[name] + _GROWTH_BYTES, f"{name}: memory grows"
    for name, node in system.nodes.items():
        assert node.stop() == 0, name
        assert "Traceback" not in node.output, name
