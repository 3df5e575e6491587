"""From a frame on the bus to the posterior that it led to: all nodes, load cells at 200 Hz, in real time.

The time is from the kernel's receipt of the cycle's first frame, which is the posterior's stamp, to the
receipt of the posterior in another process. A strain vector waits for the palm pose after it, so the poses'
period is part of it; an arm's controller sends them at 500 Hz. It is taken from the first sweep on, with the
ways back between the sweeps, not while the nodes start.

All four nodes run: the mapping node records what the filter node localizes on. The latency
is divided into its parts by the times that DDS records for each message: when it was sent, and when this
process received it. For comparison, two things are measured in the same minute: how late the machine wakes a
process that only sleeps, and how long a node takes that does nothing but send each strain message back,
from the sending of the strain and from the frame.

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
"""Of a serialized message that begins with a header: after CDR's own four bytes."""

STAMP, SENT, RECEIVED = range(3)


def store_scan(path: Path, feature: str = "bump") -> None:
    """A training scan of ``feature``, in a scan file."""
    train = simulate_scan(feature, seed=1)
    with ScanStore.create(path, load_scene(resource_path(f"config/scenes/{feature}.yaml"))) as store:
        for rows in train.slices():
            store.begin_sweep()
            store.append(train.stamp_ns[rows], train.odometry[rows], train.strain[rows])
            store.end_sweep()


class Way:
    """Stamp, sending and receipt of the messages of a topic, ns of the system's clock.

    By DDS: this process also waits for services, and looks at what came later.
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
        """(n, 3) those stamped at ``begin_ns`` or later, in the order of their stamps, each stamp once."""
        times = np.array(self._times, dtype=np.int64).reshape(-1, 3)
        times = times[times[:, STAMP] >= begin_ns]
        return times[np.unique(times[:, STAMP], return_index=True)[1]]


def parts_ms(strains: np.ndarray, poses: np.ndarray, posteriors: np.ndarray) -> dict[str, np.ndarray]:
    """Where the time of each posterior went, ms; the rows of all three are from :meth:`Way.since`."""
    strains = strains[np.searchsorted(strains[:, STAMP], posteriors[:, STAMP])]
    after = np.searchsorted(poses[:, STAMP], posteriors[:, STAMP])
    pose_received = np.maximum.accumulate(poses[:, RECEIVED])[np.minimum(after, len(poses) - 1)]
    ready = np.maximum(strains[:, RECEIVED], pose_received)
    parts = {
        "driver": strains[:, SENT] - strains[:, STAMP],
        "strain's way": strains[:, RECEIVED] - strains[:, SENT],
        "wait for the pose": ready - strains[:, RECEIVED],
        "filter": posteriors[:, SENT] - ready,
        "posterior's way": posteriors[:, RECEIVED] - posteriors[:, SENT],
        "all": posteriors[:, RECEIVED] - posteriors[:, STAMP],
    }
    return {name: times * 1e-6 for name, times in parts.items()}


def end_to_end(sweeps: int, worst: int) -> list[dict[str, Any]]:
    """Times over ``sweeps`` sweeps at unknown places; prints the parts of the ``worst`` ones."""
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
        posteriors = Way(nodes, Posterior, "filter/posterior", reliable)
        strains = Way(nodes, StrainVectors, "strain", BEST_EFFORT)
        poses = Way(nodes, PoseStamped, "palm_pose", reliable)
        echoes = Way(nodes, StrainVectors, "echo", reliable)
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
    told = posteriors.since(begin_ns)
    parts = parts_ms(strains.since(begin_ns), poses.since(begin_ns), told)
    echoed = echoes.since(begin_ns)
    echo_ms = echoed_ms(strains.since(begin_ns), echoed)
    floor_ms = (echoed[:, RECEIVED] - echoed[:, STAMP]) * 1e-6
    late = [machine.during(*one) for one in told[:, [STAMP, RECEIVED]]]
    print_worst(parts | {"machine late": np.array(late)}, (told[:, STAMP] - begin_ns) * 1e-9, worst)
    return [
        *rows(parts, echo_ms, machine, elapsed_s, cores),
        row("frame to a trivial node's echo, 99th percentile", np.percentile(floor_ms, 99), "ms"),
        row("frame to a trivial node's echo, median", np.median(floor_ms), "ms"),
        row("processor use of the measuring process", measuring, "cores"),
    ]


def echoed_ms(strains: np.ndarray, echoes: np.ndarray) -> np.ndarray:
    """Time from the sending of a strain message to the receipt of its echo, ms."""
    _, sent, back = np.intersect1d(strains[:, STAMP], echoes[:, STAMP], return_indices=True)
    return (echoes[back, RECEIVED] - strains[sent, SENT]) * 1e-6


def print_worst(parts: dict[str, np.ndarray], at_s: np.ndarray, worst: int) -> None:
    """Print the parts of the ones that took longest."""
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
        row("a trivial node's echo of the strain, 99th percentile", np.percentile(echo_ms, 99), "ms"),
        row("a trivial node's echo of the strain, median", np.median(echo_ms), "ms"),
        *(row(f"processor use at 200 Hz: {node}", share, "cores") for node, share in cores.items()),
        row("processor use at 200 Hz: all four nodes", sum(cores.values()), "cores", "<= 1"),
        row(f"{name}: the machine's own latest wake-up", machine.late[:, 1].max(initial=0.0), "ms"),
        row(f"{name}: time the machine's host took", machine.stolen_s, "s", seconds=elapsed_s),
    ]


def main() -> None:
    """Measure and record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sweeps", type=int, default=8, help="of 7.5 s each, with ways back of 1 s")
    parser.add_argument("--worst", type=int, default=0, help="print where the time of the longest went")
    args = parser.parse_args()
    record(end_to_end(args.sweeps, args.worst))


if __name__ == "__main__":
    main()
