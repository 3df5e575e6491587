"""Load of the live filter node: processor time, memory, posteriors, and their delay at a rate of the strain.

    scripts/in_env python benchmarks/live.py [--rate HZ] [--seconds S]     # as root: chrt -f 5 before it

Starts the installed filter on a simulated scan of the bump, which was used before, and publishes sweeps to
it, forward and backward, with poses at 100 Hz. Prints the fraction of a core that the filter takes, its
resident memory, the fraction of strain vectors that got a posterior, and how long after the strain it was
published, ms. Before it, the same of a node of rclpy with the same topics that computes nothing; after it,
the processor time in times of that node's.
"""

import argparse
import contextlib
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.executors import ExternalShutdownException

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.demo.nodes import node_command, own_domain
from tactile_localizer.io.scans.learned import ready_localizer
from tactile_localizer.io.scans.writer import ScanWriter
from tactile_localizer.msg import Posterior, StrainVectors
from tactile_localizer.ros.base.qos import STRAIN
from tactile_localizer.ros.conversions import fill, from_ns
from tactile_localizer.sim import shipped_scene, simulate_recording
from tactile_localizer.streams.runs import to_ns

_POSE_RATE_HZ = 100.0


class Hand:
    """Publishes strain and poses of a simulated hand, and measures what the filter makes of them."""

    def __init__(self) -> None:
        self._node = rclpy.create_node("hand")
        self._node.create_subscription(Posterior, "tactile_filter/posterior", self._on_posterior, 1000)
        self._strains = self._node.create_publisher(StrainVectors, "strain", STRAIN)
        self._poses = self._node.create_publisher(PoseStamped, "palm_pose", 100)
        self._message = StrainVectors(phalanges=["index", "middle"])
        self.delays_ms: list[float] = []

    def _on_posterior(self, message: Posterior) -> None:
        if not message.stale:
            self.delays_ms.append(1e-6 * (time.time_ns() - to_ns(message.header.stamp)))

    def send_pose(self, x: float, y: float) -> None:
        """Publish a pose, stamped now."""
        pose = PoseStamped()
        pose.header.frame_id, pose.header.stamp = "material", from_ns(time.time_ns())
        pose.pose.position.x, pose.pose.position.y = x, y
        self._poses.publish(pose)

    def send_strain(self, strain: np.ndarray, number: int) -> None:
        """Publish a strain vector with its number, stamped now."""
        status, numbers = np.zeros(2, np.uint8), np.full(2, number, np.uint32)
        fill(self._message, time.time_ns(), strain, status, numbers)
        self._strains.publish(self._message)

    def receive_until(self, time_s: float) -> None:
        """Receive posteriors until a time of the monotonic clock."""
        while (left_s := time_s - time.monotonic()) > 0:
            rclpy.spin_once(self._node, timeout_sec=left_s)


def measure(hand: Hand, node: subprocess.Popen[bytes], rate_hz: float, seconds: float) -> tuple[float, str]:
    """Fraction of a core that a node takes, and the figures of the run in a line."""
    while not hand.delays_ms:
        assert node.poll() is None
        hand.send_pose(0.0, 0.0)
        hand.send_strain(np.zeros(16), 0)
        hand.send_pose(0.0, 0.0)
        hand.receive_until(time.monotonic() + 0.1)
    (sweep,) = simulate_recording("bump", 1, "test", sweeps=1, rate=rate_hz).sweeps
    forth = np.arange(len(sweep))
    samples = np.resize(np.concatenate([forth, forth[::-1]]), round(seconds * rate_hz))
    hand.delays_ms.clear()
    began_s, used_s = time.monotonic(), _processor_s(node.pid)
    for number, sample in enumerate(samples):
        hand.receive_until(began_s + number / rate_hz)
        hand.send_strain(sweep.strain[sample], number + 1)
        if number % max(1, round(rate_hz / _POSE_RATE_HZ)) == 0:
            hand.send_pose(*map(float, sweep.position[sample]))
    load = (_processor_s(node.pid) - used_s) / (time.monotonic() - began_s)
    hand.receive_until(time.monotonic() + 1.0)
    median_ms, late_ms = np.quantile(hand.delays_ms, [0.5, 0.99])
    answered = len(hand.delays_ms) / len(samples)
    delays = f"{answered:.1%} answered, {median_ms:.1f}, {late_ms:.1f} ms"
    return load, f"{rate_hz:g} Hz: {load:.3f} of a core, {_memory(node.pid):.0f} MB, {delays}"


def run_bare_node() -> None:
    """Receive the inputs of the filter, and publish an empty posterior per strain vector."""
    rclpy.init()
    node, message = rclpy.create_node("tactile_filter"), Posterior(axes=["x", "y"], mean=[0.0, 0.0])
    posteriors = node.create_publisher(Posterior, "~/posterior", 100)

    def answer(strain: StrainVectors) -> None:
        message.header.stamp = strain.header.stamp
        posteriors.publish(message)

    node.create_subscription(StrainVectors, "strain", answer, STRAIN)
    node.create_subscription(PoseStamped, "palm_pose", lambda pose: None, STRAIN)
    with contextlib.suppress(ExternalShutdownException):
        rclpy.spin(node)


def _processor_s(pid: int) -> float:
    """Processor time of a process so far, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _memory(pid: int) -> float:
    """Resident memory of a process, MB."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="Load of the live filter node.")
    parser.add_argument("--rate", type=float, nargs="+", default=[100.0, 1000.0], metavar="HZ")
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--bare", action="store_true", help="be the node of rclpy that computes nothing")
    given = parser.parse_args()
    if given.bare:
        run_bare_node()
        return
    with own_domain(), tempfile.TemporaryDirectory() as folder:
        rclpy.init()
        path = Path(folder, "bump_scan")
        with ScanWriter(path, shipped_scene("bump")) as writer:
            for sweep in simulate_recording("bump", 1).sweeps:
                writer.add(sweep)
        ready_localizer(path, shipped_scene("bump"), Configuration(), np.random.default_rng(0))
        hand = Hand()
        commands = {
            "bare": [sys.executable, __file__, "--bare"],
            "filter": node_command("filter_node", {"scan_file": path}),
        }
        for rate_hz in given.rate:
            loads = []
            for name, command in commands.items():
                hand.delays_ms.clear()
                with subprocess.Popen(command) as node:
                    load, figures = measure(hand, node, rate_hz, given.seconds)
                    print(f"{name:6} at {figures}", flush=True)
                    loads.append(load)
                    node.terminate()
            print(f"filter / bare at {rate_hz:g} Hz: {loads[1] / loads[0]:.2f}", flush=True)


if __name__ == "__main__":
    main()
