"""Speed and memory of the replay of a bag: 10 minutes at 200 Hz, two phalanges, on one core.

Run by ``make bench``, or alone: ``scripts/in_env python benchmarks/replay.py [--minutes 10]``; with
``--command`` the time and memory of ``tactile-localizer replay`` are measured instead.
"""

from __future__ import annotations

import argparse
import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import tempfile
import time
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
from command import run_command
from first_estimate import store
from record import record, row

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer, learn
from tactile_localizer.io.bags.reader import typestore
from tactile_localizer.io.bags.recording import read_bag
from tactile_localizer.io.bags.writer import BagWriter
from tactile_localizer.io.configuration_file import load_configuration
from tactile_localizer.io.scans.learned import learned_calibration
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.offline.metrics import timing
from tactile_localizer.offline.replay import replay
from tactile_localizer.resources import resource_path
from tactile_localizer.sim import simulate_scan

RATE_HZ = 200.0
STRAIN, POSE = "/strain", "/palm_pose"
TOPICS = {STRAIN: "tactile_localizer/msg/StrainVectors", POSE: "geometry_msgs/msg/PoseStamped"}
PHALANGES = ["index", "middle"]
LIMITS = {"default": ">= 120", "balanced": ">= 250"}


def write_bag(path: Path, minutes: float) -> int:
    """Write sweeps over the bump with strain and pose at 200 Hz; returns the number of strain messages."""
    store = typestore()
    types = store.types
    header, stamp_type = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    wanted = round(minutes * 60 * RATE_HZ)
    test = simulate_scan("bump", 1, "test", sweeps=round(minutes * 10) + 2, rate=RATE_HZ)
    with BagWriter(path, TOPICS) as bag:
        for n in range(wanted):
            stamp_ns = 1_700_000_000_000_000_000 + round(n * 1e9 / RATE_HZ)
            stamp = stamp_type(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
            strain = types[TOPICS[STRAIN]](
                header=header(stamp=stamp, frame_id=""),
                phalanges=PHALANGES,
                strain=test.strain[n],
                status=np.zeros(2, np.uint8),
                sequence=np.full(2, n, np.uint32),
                channels=np.full(2, 8, np.uint16),
            )
            x, y = map(float, test.odometry[n])
            place = types["geometry_msgs/msg/Point"](x=x, y=y, z=0.0)
            turn = types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
            pose = types["geometry_msgs/msg/Pose"](position=place, orientation=turn)
            message = types[TOPICS[POSE]](header=header(stamp=stamp, frame_id="base_link"), pose=pose)
            bag.write(POSE, stamp_ns, store.serialize_cdr(message, TOPICS[POSE]))
            bag.write(STRAIN, stamp_ns, store.serialize_cdr(strain, TOPICS[STRAIN]))
    return wanted


def measure(minutes: float) -> list[dict[str, Any]]:
    """Measure the processor time of reading and replaying the bag, and of single samples."""
    scene = load_scene(resource_path("config/scenes/bump.yaml"))
    scan = simulate_scan("bump", 1).to_scan()
    with tempfile.TemporaryDirectory() as folder:
        strains = write_bag(Path(folder) / "bag", minutes)
        begun_s = time.process_time()
        recording = read_bag(Path(folder) / "bag", scene, by_status=False)
        read_s = time.process_time() - begun_s
    real_s = minutes * 60
    calibration = learn(scan, scene)
    rows = [row("replay: reading the bag", read_s / real_s * 1e3, "ms per second of bag")]
    for name, limit in LIMITS.items():
        configuration = load_configuration(name) if name != "default" else Configuration()
        rng = np.random.default_rng(1)
        localizer = build_localizer(scan, scene, configuration, rng, calibration=calibration)
        begun_s = time.process_time()
        tracks = replay(localizer, recording)
        replay_s = time.process_time() - begun_s
        taken = timing(tracks)
        assert sum(map(len, tracks)) >= strains - 2
        what = {"minutes": minutes, "rate_hz": RATE_HZ, "phalanges": len(PHALANGES), "configuration": name}
        rows += [
            row(
                f"replay of a bag, {name}: times real time", real_s / (read_s + replay_s), "x", limit, **what
            ),
            row(f"replay, {name}: localizing", replay_s / real_s * 1e3, "ms per second of bag"),
            row(f"replay, {name}: measurement update, median", taken["update_median_us"], "us"),
            row(f"replay, {name}: per sample, mean", taken["strain_mean_us"], "us"),
        ]
    tracemalloc.start()
    tracks = replay(localizer, recording)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    rows.append(row("replay: memory per sample", peak / sum(map(len, tracks)), "bytes", "<= 400"))
    return rows


def measure_command(minutes: float) -> list[dict[str, Any]]:
    """Measure the command on a scan with a stored calibration, without and with ``--json``."""
    scan, scene = simulate_scan("bump", 1).to_scan(), load_scene(resource_path("config/scenes/bump.yaml"))
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        store(folder / "scan.db", scan, scene)
        learned_calibration(folder / "scan.db", scan, scene)
        write_bag(folder / "bag", minutes)
        for options in ([], ["--json", "out.json"]):
            arguments = ["replay", "bag", "--scan", "scan.db", *options]
            cost = run_command(arguments, folder, os.environ)
            title = " ".join(["command: replay", *options[:1], f"of {minutes:g} minutes"])
            rows.append(row(title, cost.cpu_s, "s", minutes=minutes, wall_s=cost.wall_s))
            rows.append(row(f"{title}: peak memory", cost.peak_mb, "MB", minutes=minutes))
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--command", action="store_true")
    given = parser.parse_args()
    record((measure_command if given.command else measure)(given.minutes))
