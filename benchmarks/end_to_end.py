"""Latency from a frame on the bus to the posterior, with all nodes running and load cells at 200 Hz.

The latency is from the kernel's receipt of the cycle's first frame, which is the posterior's stamp, to the
receipt of the posterior in another process. A strain vector waits for the next palm pose, so the period of
the poses counts; an arm's controller sends them at 500 Hz. It is measured from the first sweep on, including
the return strokes, but not while the nodes start. The mapping node records what the filter node localizes on.

The latency is divided into parts by the send and receive times that DDS records for each message. Two
references are measured at the same time: the delay with which the machine wakes a process that only sleeps,
and the latency of a node that only returns each strain message.

Run by ``make bench``, or alone: ``scripts/in_env python benchmarks/end_to_end.py [--sweeps 8] [--worst 10]``.
"""

from __future__ import annotations

import argparse
import struct
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from machine import Machine
from nodes import BEST_EFFORT, BUS, Nodes, cpu_s
from rclpy.qos import QoSProfile
from record import record, row

from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.msg import Posterior, StrainVectors
from tactile_localizer.resources import resource_path
from tactile_localizer.sim import simulate_scan

POSE_RATE_HZ = 500.0
LOAD_CELL_RATE_HZ = 200.0

_STAMP = struct.Struct("<iI")
_STAMP_AT = 4
"""Offset of the stamp in a serialized message that begins with a header, after the four bytes of CDR."""

STAMP, SENT, RECEIVED = range(3)


def store_scan(path: Path, feature: str = "bump") -> None:
    """Write a training scan of ``feature`` to a scan file."""
    train = simulate_scan(feature, seed=1)
    with ScanStore.create(path, load_scene(resource_path(f"config/scenes/{feature}.yaml"))) as store:
        for rows in train.slices():
            store.begin_sweep()
            store.append(train.stamp_ns[rows], train.odometry[rows], train.strain[rows])
            store.end_sweep()


class MessageTimes:
    """Stamp, send and receive time of the messages of a topic, ns of the system clock.

    The times are those of DDS, because this process may take the messages later.
    """

    def __init__(self, nodes: Nodes, kind: Any, topic: str, quality: QoSProfile) -> None:
        self._times: list[tuple[int, int, int]] = []
        nodes.probe.create_subscription(kind, topic, self._take, quality, raw=True)

    def _take(self, message: bytes, info: dict[str, Any]) -> None:
        s, ns = _STAMP.unpack_from(message, _STAMP_AT)
        self._times.append((s * 1_000_000_000 + ns, info["source_timestamp"], info["received_timestamp"]))

    def __len__(self) -> int:
        return len(self._times)

    def since(self, begin_ns: int) -> np.ndarray:
        """Times (n, 3) of the messages stamped from ``begin_ns`` on, sorted, each stamp once."""
        times = np.array(self._times, dtype=np.int64).reshape(-1, 3)
        times = times[times[:, STAMP] >= begin_ns]
        return times[np.unique(times[:, STAMP], return_index=True)[1]]


def parts_ms(strains: np.ndarray, poses: np.ndarray, posteriors: np.ndarray) -> dict[str, np.ndarray]:
    """Parts of the latency of each posterior, ms; the times are from :meth:`MessageTimes.since`."""
    strains = strains[np.searchsorted(strains[:, STAMP], posteriors[:, STAMP])]
    after = np.searchsorted(poses[:, STAMP], posteriors[:, STAMP])
    pose_received = np.maximum.accumulate(poses[:, RECEIVED])[np.minimum(after, len(poses) - 1)]
    ready = np.maximum(strains[:, RECEIVED], pose_received)
    parts = {
        "driver": strains[:, SENT] - strains[:, STAMP],
        "transport of the strain": strains[:, RECEIVED] - strains[:, SENT],
        "wait for the pose": ready - strains[:, RECEIVED],
        "filter": posteriors[:, SENT] - ready,
        "transport of the posterior": posteriors[:, RECEIVED] - posteriors[:, SENT],
        "all": posteriors[:, RECEIVED] - posteriors[:, STAMP],
    }
    return {name: times * 1e-6 for name, times in parts.items()}


def end_to_end(sweeps: int, worst: int) -> list[dict[str, Any]]:
    """Latencies over ``sweeps`` sweeps from unknown starts; prints the parts of the ``worst`` longest."""
    with tempfile.TemporaryDirectory() as directory, Nodes() as nodes:
        scan = Path(directory, "scan.db")
        store_scan(scan)
        simulator = {"mode": "localize", "load_cell_rate_hz": LOAD_CELL_RATE_HZ, "pose_rate_hz": POSE_RATE_HZ}
        recording = {
            "scan_file": f"{directory}/recorded.db",
            "scene_file": resource_path("config/scenes/bump.yaml"),
            "sweep_detection": "both_ways",
        }
        started = {
            "simulator": nodes.start_node("simulator_node", BUS | simulator),
            "driver": nodes.start_node("driver_node", BUS | {"tare_file": f"{directory}/tare.yaml"}),
            "filter": nodes.start_node("filter_node", {"scan_file": scan}),
            "mapping": nodes.start_node("mapping_node", recording),
        }
        nodes.start(Path(__file__).parent / "echo.py")
        reliable = QoSProfile(depth=1000)
        posteriors = MessageTimes(nodes, Posterior, "filter/posterior", reliable)
        strains = MessageTimes(nodes, StrainVectors, "strain", BEST_EFFORT)
        poses = MessageTimes(nodes, PoseStamped, "palm_pose", reliable)
        echoes = MessageTimes(nodes, StrainVectors, "echo", reliable)
        nodes.watch_sweeps()
        nodes.until(lambda: len(posteriors), "the first posterior", 300)
        with Machine() as machine:
            cpu = {name: cpu_s(process) for name, process in started.items()}
            own_s = time.process_time()
            begin_ns = time.time_ns()
            for _ in range(sweeps):
                nodes.sweep()
            elapsed_s = (time.time_ns() - begin_ns) * 1e-9
            cores = {name: (cpu_s(process) - cpu[name]) / elapsed_s for name, process in started.items()}
            measuring = (time.process_time() - own_s) / elapsed_s
    received = posteriors.since(begin_ns)
    parts = parts_ms(strains.since(begin_ns), poses.since(begin_ns), received)
    echoed = echoes.since(begin_ns)
    echo_ms = echoed_ms(strains.since(begin_ns), echoed)
    floor_ms = (echoed[:, RECEIVED] - echoed[:, STAMP]) * 1e-6
    late = [machine.during(*one) for one in received[:, [STAMP, RECEIVED]]]
    print_worst(parts | {"machine late": np.array(late)}, (received[:, STAMP] - begin_ns) * 1e-9, worst)
    return [
        *rows(parts, echo_ms, machine, elapsed_s, cores),
        row("frame to the echo of a node without work, 99th percentile", np.percentile(floor_ms, 99), "ms"),
        row("frame to the echo of a node without work, median", np.median(floor_ms), "ms"),
        row("processor use of the measuring process", measuring, "cores"),
    ]


def echoed_ms(strains: np.ndarray, echoes: np.ndarray) -> np.ndarray:
    """Time from the sending of a strain message to the receipt of its echo, ms."""
    _, sent, back = np.intersect1d(strains[:, STAMP], echoes[:, STAMP], return_indices=True)
    return (echoes[back, RECEIVED] - strains[sent, SENT]) * 1e-6


def print_worst(parts: dict[str, np.ndarray], at_s: np.ndarray, worst: int) -> None:
    """Print the parts of the ``worst`` longest latencies."""
    for i in np.sort(np.argsort(parts["all"])[len(at_s) - worst :]):
        print(
            f"{at_s[i]:8.3f} s: "
            + ", ".join(f"{name} {times[i]:.1f}" for name, times in parts.items())
            + " ms"
        )


def rows(
    parts: dict[str, np.ndarray],
    echo_ms: np.ndarray,
    machine: Machine,
    elapsed_s: float,
    cores: dict[str, float],
) -> list[dict[str, Any]]:
    """The measurements."""
    times = parts["all"]
    name = "end to end: frame to posterior"
    what = {
        "rate_hz": LOAD_CELL_RATE_HZ,
        "pose_rate_hz": POSE_RATE_HZ,
        "posteriors": len(times),
        "posteriors_per_s": len(times) / elapsed_s,
        "cores_used": cores,
        "parts_median_ms": {part: round(float(np.median(ms)), 3) for part, ms in parts.items()},
        "parts_p99_ms": {part: round(float(np.percentile(ms, 99)), 3) for part, ms in parts.items()},
    }
    return [
        row(f"{name}, 99th percentile", np.percentile(times, 99), "ms", "<= 3", **what),
        row(f"{name}, median", np.median(times), "ms"),
        row(f"{name}, longest", times.max(), "ms"),
        *(
            row(f"{name}, 99th percentile: {part}", np.percentile(ms, 99), "ms")
            for part, ms in parts.items()
            if part != "all"
        ),
        row("echo of the strain by a node without work, 99th percentile", np.percentile(echo_ms, 99), "ms"),
        row("echo of the strain by a node without work, median", np.median(echo_ms), "ms"),
        *(row(f"processor use at 200 Hz: {node}", used, "cores") for node, used in cores.items()),
        row("processor use at 200 Hz: all four nodes", sum(cores.values()), "cores", "<= 1"),
        row(f"{name}: longest wake-up delay of the machine", machine.late[:, 1].max(initial=0.0), "ms"),
        row(
            f"{name}: time for which the host did not run the machine",
            machine.stolen_s,
            "s",
            seconds=elapsed_s,
        ),
    ]


def main() -> None:
    """Measure and record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--sweeps", type=int, default=8, help="number of sweeps, 7.5 s each with a return stroke of 1 s"
    )
    parser.add_argument(
        "--worst", type=int, default=0, help="number of longest latencies whose parts are printed"
    )
    args = parser.parse_args()
    record(end_to_end(args.sweeps, args.worst))


if __name__ == "__main__":
    main()
