"""From a frame on the bus to the posterior that it led to: all nodes, load cells at 200 Hz, in real time.

The time is from the kernel's receipt of the cycle's first frame, which is the posterior's stamp, to the
receipt of the posterior in another process. A strain vector waits for the palm pose after it, so the poses'
period is part of it; an arm's controller sends them at 500 Hz. It is taken from the first sweep on, with the
ways back between the sweeps, not while the nodes start.

Run by ``make bench``, or alone: ``scripts/in_env python benchmarks/end_to_end.py [--sweeps 3]``.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from nodes import BUS, Nodes, cpu_s
from rclpy.qos import DurabilityPolicy, QoSProfile
from record import record, row
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from tactile_localizer.io.scan_store import ScanStore
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.msg import Posterior
from tactile_localizer.resources import resource_path
from tactile_localizer.sim import simulate_scan

POSE_RATE_HZ = 500.0
LOAD_CELL_RATE_HZ = 200.0


def store_scan(path: Path) -> None:
    """A training scan of the bump, in a scan file."""
    train = simulate_scan("bump", seed=1)
    with ScanStore.create(path, load_scene(resource_path("config/scenes/bump.yaml"))) as store:
        for rows in train.slices():
            store.begin_sweep()
            store.append(train.stamp_ns[rows], train.odometry[rows], train.strain[rows])
            store.end_sweep()


class Clock:
    """Takes the time of each posterior's way."""

    def __init__(self, nodes: Nodes) -> None:
        self.taken_ms: list[float] = []
        self.sweeping: bool | None = None
        nodes.probe.create_subscription(Posterior, "filter/posterior", self._take, QoSProfile(depth=1000))
        kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        nodes.probe.create_subscription(Bool, "simulator/sweep_active", self._keep, kept)

    def _take(self, message: Posterior, info: dict[str, Any]) -> None:
        # When DDS received it: this process also waits for services, and looks at what came later.
        if not message.stale:
            stamp_ns = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
            self.taken_ms.append((info["received_timestamp"] - stamp_ns) * 1e-6)

    def _keep(self, message: Bool) -> None:
        self.sweeping = message.data


def end_to_end(sweeps: int) -> list[dict[str, Any]]:
    """Times over ``sweeps`` sweeps at unknown places."""
    with tempfile.TemporaryDirectory() as directory, Nodes() as nodes:
        scan = Path(directory, "scan.db")
        store_scan(scan)
        simulator = {"mode": "localize", "load_cell_rate_hz": LOAD_CELL_RATE_HZ, "pose_rate_hz": POSE_RATE_HZ}
        started = {
            "simulator": nodes.start_node("simulator_node", BUS | simulator),
            "driver": nodes.start_node("driver_node", BUS | {"tare_file": f"{directory}/tare.yaml"}),
            "filter": nodes.start_node("filter_node", {"scan_file": scan}),
        }
        clock = Clock(nodes)
        cpu, begin_s = dict.fromkeys(started, 0.0), 0.0
        for sweep in range(sweeps):
            nodes.call(Trigger, "simulator/prepare")
            if sweep == 0:
                nodes.until(lambda: clock.taken_ms, "the first posterior", 60)
                clock.taken_ms.clear()
                cpu, begin_s = {name: cpu_s(process) for name, process in started.items()}, time.monotonic()
            clock.sweeping = None
            nodes.call(Trigger, "simulator/sweep")
            nodes.until(lambda: clock.sweeping is False, "the end of the sweep", 60)
        elapsed_s = time.monotonic() - begin_s
        cores = {name: (cpu_s(process) - cpu[name]) / elapsed_s for name, process in started.items()}
    what = {
        "rate_hz": LOAD_CELL_RATE_HZ,
        "pose_rate_hz": POSE_RATE_HZ,
        "posteriors": len(clock.taken_ms),
        "posteriors_per_s": len(clock.taken_ms) / elapsed_s,
        "cores_used": cores,
    }
    return [
        row(
            "end to end: frame to posterior, 99th percentile",
            np.percentile(clock.taken_ms, 99),
            "ms",
            "<= 10",
            **what,
        ),
        row("end to end: frame to posterior, median", np.median(clock.taken_ms), "ms", **what),
    ]


def main() -> None:
    """Measure and record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sweeps", type=int, default=3)
    record(end_to_end(parser.parse_args().sweeps))


if __name__ == "__main__":
    main()
