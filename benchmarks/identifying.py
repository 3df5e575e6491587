"""Cost of identifying the feature: one filter node with three scans against three with one scan each.

All receive the same sweeps at the same time, in real time; the processor time is that of each process.
``hand.py`` measures the localizers alone.

Run by ``make bench``, or alone: ``scripts/in_env python benchmarks/identifying.py [--sweeps 6]``.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

from end_to_end import store_scan
from nodes import BUS, ROOT, Nodes, cpu_s
from record import record, row

from tactile_localizer.msg import Posterior

FEATURES = ("bump", "snap", "grommet")


def identifying(sweeps: int) -> list[dict[str, Any]]:
    """Processor time of each filter over ``sweeps`` sweeps of the bump, and their ratio."""
    with tempfile.TemporaryDirectory() as directory, Nodes() as nodes:
        files = [Path(directory, f"{feature}.db") for feature in FEATURES]
        for feature, file in zip(FEATURES, files, strict=True):
            store_scan(file, feature)
        nodes.start_node("simulator_node", BUS | {"mode": "localize"})
        nodes.start_node("driver_node", BUS | {"tare_file": f"{directory}/tare.yaml"})
        scans = {feature: f"scan_file:={file}" for feature, file in zip(FEATURES, files, strict=True)}
        scans["all"] = f"candidate_scan_files:=[{', '.join(map(str, files))}]"
        received: Counter[str] = Counter()
        filters = {}
        for name, scan in scans.items():
            nodes.probe.create_subscription(
                Posterior, f"{name}/posterior", lambda _, name=name: received.update([name]), 1000
            )
            command = ROOT / "scripts" / "filter_node"
            filters[name] = nodes.start(command, "--ros-args", "-r", f"__node:={name}", "-p", scan)
        nodes.until(lambda: len(received) == len(filters), "the first posteriors", 600)
        nodes.watch_sweeps()
        received.clear()
        taken = {name: -cpu_s(process) for name, process in filters.items()}
        for _ in range(sweeps):
            nodes.sweep()
        for name, process in filters.items():
            taken[name] += cpu_s(process)
    apart = sum(taken[feature] for feature in FEATURES)
    return [
        row(
            "filter that identifies, relative to one filter per scan",
            taken["all"] / apart,
            "x",
            "<= 1",
            posteriors=received,
        ),
        *(row(f"processor time, filter of {name}", s, "s") for name, s in taken.items()),
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sweeps", type=int, default=6, help="number of sweeps, 7.5 s each")
    record(identifying(parser.parse_args().sweeps))
