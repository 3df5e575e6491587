"""How fast a bag is replayed: 10 minutes at 200 Hz, two phalanges, with the preset ``balanced``, on one core.

Run by ``make bench``, or alone: ``scripts/in_env python benchmarks/replay.py [--minutes 10]``.
"""

from __future__ import annotations

import argparse
import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from record import record, row

from tactile_localizer.core.factory import build_localizer
from tactile_localizer.io.bags.reader import typestore
from tactile_localizer.io.bags.recording import read_bag
from tactile_localizer.io.bags.writer import BagWriter
from tactile_localizer.io.configuration_file import load_configuration
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.offline.metrics import timing
from tactile_localizer.offline.replay import replay
from tactile_localizer.resources import resource_path
from tactile_localizer.sim import simulate_scan

RATE_HZ = 200.0
STRAIN, POSE = "/strain", "/palm_pose"
TOPICS = {STRAIN: "tactile_localizer/msg/StrainVectors", POSE: "geometry_msgs/msg/PoseStamped"}
PHALANGES = ["index", "middle"]


def write_bag(path: Path, minutes: float) -> int:
    """Sweeps over the bump one after another, strain and pose at 200 Hz each; returns how many strains."""
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
    """Read and replay the bag, in processor time; single strains by the clock."""
    scene = load_scene(resource_path("config/scenes/bump.yaml"))
    scan = simulate_scan("bump", 1).to_scan()
    with tempfile.TemporaryDirectory() as folder:
        strains = write_bag(Path(folder) / "bag", minutes)
        begun_s = time.process_time()
        recording = read_bag(Path(folder) / "bag", scene, by_status=False)
        read_s = time.process_time() - begun_s
    begun_s = time.process_time()
    localizer = build_localizer(scan, scene, load_configuration("balanced"), np.random.default_rng(1))
    tracks = replay(localizer, recording)
    replay_s = time.process_time() - begun_s
    taken = timing(tracks)
    assert sum(map(len, tracks)) >= strains - 2
    real_s = minutes * 60
    return [
        row(
            "replay of a bag, times real time",
            real_s / (read_s + replay_s),
            "x",
            ">= 100",
            minutes=minutes,
            rate_hz=RATE_HZ,
            phalanges=len(PHALANGES),
            configuration="balanced",
        ),
        row("replay: reading the bag", read_s / real_s * 1e3, "ms a second of bag"),
        row("replay: localising", replay_s / real_s * 1e3, "ms a second of bag"),
        row("replay: weighed strain, median", taken["update_median_us"], "us"),
        row("replay: any strain, mean", taken["strain_mean_us"], "us"),
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    record(measure(parser.parse_args().minutes))
