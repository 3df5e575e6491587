"""Speed of the driver: decoding a recorded stream, and reading a bus between processes.

Run by ``make bench``, or alone: ``scripts/in_env python benchmarks/driver.py [--seconds 60]``.
"""

from __future__ import annotations

import argparse
import itertools
import json
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import can
import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from nodes import BEST_EFFORT, BUS, CHANNEL, PORT, Nodes, cpu_s
from record import record, row

from tactile_localizer.io.can.assembler import CycleAssembler
from tactile_localizer.io.can.layout import SignalNames, load_dbc, phalanges_of
from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol
from tactile_localizer.msg import StrainVectors
from tactile_localizer.resources import resource_path

DBC = resource_path("config/loadcells.dbc")
BATCH = 1024


def recorded_stream(protocol: LoadCellProtocol, cycles: int, rate_hz: float) -> list[can.Message]:
    """Frames of ``cycles`` samples of every phalanx at ``rate_hz``."""
    rng = np.random.default_rng(0)
    frames = []
    for n in range(cycles):
        for p in range(len(protocol.phalanges)):
            frames += protocol.encode(p, rng.normal(0, 0.5, 8), n, stamp_s=1.7e9 + n / rate_hz)
    return frames


def decode(cycles: int = 5000, rate_hz: float = 500.0) -> list[dict[str, Any]]:
    """Decode 2 classic frames of each of 14 phalanges at 500 Hz, from memory and from a candump log."""
    protocol = LoadCellProtocol.from_dbc(DBC, phalanges_of(load_dbc(DBC), SignalNames()))
    frames = recorded_stream(protocol, cycles, rate_hz)
    recorded_s = cycles / rate_hz

    def run(stream: Iterable[can.Message]) -> float:
        assembler = CycleAssembler(protocol, wait_s=0.01)
        stream = iter(stream)
        begin_s = time.process_time()
        cycles_made = 0
        while batch := list(itertools.islice(stream, BATCH)):
            cycles_made += len(assembler.feed(batch))
        taken_s = time.process_time() - begin_s
        assert cycles_made >= cycles - 5 and assembler.counts.incomplete <= 12  # noqa: PT018
        return recorded_s / taken_s

    in_memory = max(run(frames) for _ in range(3))
    with tempfile.TemporaryDirectory() as directory:
        log = Path(directory, "hand.log")
        with can.Logger(log) as logger:
            for frame in frames:
                logger.on_message_received(frame)
        from_log = max(run(can.LogReader(log)) for _ in range(3))
    what = {"phalanges": 14, "frames_per_s": 28 * rate_hz, "frames": len(frames), "cores": 1}
    return [
        row("driver: decode and assemble a recorded stream", in_memory, "x real time", ">= 20", **what),
        row("driver: the same, read from a candump log by python-can", from_log, "x real time", **what),
    ]


def send(rate_hz: float, seconds: float) -> int:
    """Send the frames of 2 phalanges, cycle by cycle at ``rate_hz``; returns their number."""
    protocol = LoadCellProtocol.from_dbc(DBC, ("index", "middle"))
    frames = recorded_stream(protocol, 160, rate_hz)  # ten rounds of the counter
    cycles = [frames[i : i + 4] for i in range(0, len(frames), 4)]
    sent = 0
    with can.Bus(interface="udp_multicast", channel=CHANNEL, port=PORT, hop_limit=0) as bus:
        begin_s = time.monotonic()
        for n in range(round(rate_hz * seconds)):
            pause_s = begin_s + n / rate_hz - time.monotonic()
            if pause_s > 0:
                time.sleep(pause_s)
            for frame in cycles[n % len(cycles)]:
                bus.send(frame)
                sent += 1
    return sent


class Health:
    """Number of received strain vectors, and the driver's latest diagnostics."""

    def __init__(self, nodes: Nodes) -> None:
        self.strains = 0
        self.diagnostics: dict[str, str] = {}
        nodes.probe.create_subscription(StrainVectors, "strain", self._count, BEST_EFFORT, raw=True)
        nodes.probe.create_subscription(DiagnosticArray, "/diagnostics", self._keep, 10)

    def _count(self, message: bytes) -> None:
        self.strains += 1

    def _keep(self, array: DiagnosticArray) -> None:
        for status in array.status:
            if status.name == "driver: CAN bus":
                self.diagnostics = {pair.key: pair.value for pair in status.values}


def bus(rate_hz: float = 1000.0, seconds: float = 60.0) -> list[dict[str, Any]]:
    """Send 2 phalanges at 1 kHz over the simulated bus to the driver, and receive its strain vectors."""
    with tempfile.TemporaryDirectory() as directory, Nodes() as nodes:
        driver = nodes.start_node("driver_node", BUS | {"tare_file": f"{directory}/tare.yaml"})
        health = Health(nodes)
        nodes.until(lambda: health.diagnostics, "the driver", 20)
        before_s = cpu_s(driver)
        sender = nodes.start(__file__, "--send", str(rate_hz), "--seconds", str(seconds))
        nodes.until(lambda: sender.poll() is not None, "the sender", seconds + 30)
        taken_s = cpu_s(driver) - before_s
        sent = int(json.loads(sender.stdout.read())["sent"])  # type: ignore[union-attr]
        settled_s = time.monotonic() + 2.5  # two more rounds of diagnostics
        nodes.until(lambda: time.monotonic() > settled_s, "the driver", 10)
    values = health.diagnostics
    dropped = int(values["queue_drops"])
    read = sum(int(values[f"frames_{kind.name.lower()}"]) for kind in FrameKind)
    missed = int(values["cycles"]) - health.strains
    what = {"rate_hz": rate_hz, "seconds": seconds, "frames_sent": sent, "phalanges": 2}
    return [
        row("driver: CPU at 2 phalanges, 1 kHz", taken_s / seconds, "cores", "<= 0.5", **what),
        row("driver: frames lost after the socket", sent - dropped - read, "frames", "<= 0", **what),
        row("driver: frames dropped by the kernel's queue", dropped, "frames", **what),
        row("driver: cycles incomplete", int(values["cycles_incomplete"]), "cycles", **what),
        row("driver: cycles that a subscriber missed", missed, "cycles", **what),
    ]


def main() -> None:
    """Measure and record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="duration of reading the bus, s")
    parser.add_argument("--send", type=float, metavar="HZ", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.send:
        print(json.dumps({"sent": send(args.send, args.seconds)}))
        return
    record([*decode(), *bus(seconds=args.seconds)])


if __name__ == "__main__":
    main()
