"""Replay of a bag without ROS gives the posteriors of the filter node."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import deserialize_message
from rosbags.highlevel import AnyReader
from support.bags import START, pose, strain, write_bag
from support.hand import stamp_of
from support.sweeps import CALIBRATION, unseen_sweep

from tactile_localizer.cli import main
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.hypotheses.convergence import State
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.scan.range import ScanRange
from tactile_localizer.io.bags.recording import read_bag
from tactile_localizer.io.strain_vectors import StrainReader
from tactile_localizer.msg import Posterior, StrainVectors
from tactile_localizer.offline.replay import replay
from tactile_localizer.ros.online_localizer import OnlineLocalizer
from tactile_localizer.sim import shipped_scene, simulate_scan
from tactile_localizer.streams.runs import stamp_of as bag_stamp_of
from tactile_localizer.streams.session import Session

PARTICLES = {"filter": "particle", "particles": 200}
_AT_ONCE = 40
"""Messages sent before the answers are waited for; fewer than a queue holds."""


def record(path: Path) -> Path:
    """Write a bag of 5 s with strain every 20 ms and poses every 30 ms, some late, missing or faulty."""
    sweep = unseen_sweep(rate=50.0)
    happened: list[tuple[str, int, Any]] = []
    for k in range(250):
        now = 20 * (k + 1)
        values = sweep.strain[k].copy()
        status = np.zeros(2, dtype=np.uint8)
        if 60 <= k < 70:  # the middle finger is silent
            values[8:], status[1] = np.nan, 1
        if k == 100:  # status OK, but not finite
            values[3] = np.nan
        happened.append(("strain", now, strain(now, ("index", "middle"), strain=values, status=status)))
    for now in range(5, 5100, 30):
        x = float(np.interp(now / 20 - 1, np.arange(len(sweep.position)), sweep.position[:, 0]))
        late = 12 if now % 4 else 0
        if not 3000 < now < 3200:  # a gap that is too long
            happened.append(("palm_pose", now + late, pose(now, "base_link", x=x)))
    return write_bag(path, sorted(happened, key=lambda one: one[1]))


def play(bag: Path, probe: Any) -> list[Any]:
    """Publish the messages of a bag in order; returns the posteriors."""
    received = probe.listen(Posterior, "tactile_filter/posterior", 1000)
    kinds = {"/strain": StrainVectors, "/palm_pose": PoseStamped}
    publishers = {
        "/strain": probe.publisher(StrainVectors, "strain", probe.best_effort),
        "/palm_pose": probe.publisher(PoseStamped, "palm_pose", 100),
    }
    probe.known_to("/tactile_filter")

    def fresh() -> list[Any]:
        return [message for message in received if not message.stale]

    with AnyReader([bag]) as reader:
        for count, (connection, _, raw) in enumerate(reader.messages(), 1):
            message = deserialize_message(raw, kinds[connection.topic])
            publishers[connection.topic].publish(message)
            probe.executor.spin_once(timeout_sec=0.002)
            if connection.topic == "/palm_pose" and count > _AT_ONCE and count % _AT_ONCE < 2:
                behind = stamp_of(message) - 150_000_000
                probe.until(lambda b=behind: fresh() and stamp_of(fresh()[-1]) >= b, "the filter to keep up")
    last = START + 5000 * 1_000_000
    probe.until(lambda: stamp_of(fresh()[-1]) >= last, "the posterior of the last strain")
    return fresh()


def test_replay_equals_the_live_filter(tmp_path, monkeypatch, node_process, probe, scan_file):
    """With particles: their random numbers are the same, too."""
    monkeypatch.chdir(tmp_path)
    bag = record(tmp_path / "bag")
    node = node_process("filter_node", {"scan_file": scan_file, "seed": 7, **PARTICLES})
    received = play(bag, probe)
    assert node.stop() == 0
    assert f" {len(received)} posteriors, " in node.output
    assert {tuple(m.axes) for m in received} == {("x", "y")}
    assert {m.header.frame_id for m in received} == {"material"}

    (tmp_path / "own.yaml").write_text(yaml.safe_dump(PARTICLES))
    command = f"replay bag --scan {scan_file} --config own.yaml --seed 7 --json out.json"
    assert main(command.split()) in (0, 1), "1: some sweep did not converge"
    updates = json.loads((tmp_path / "out.json").read_text())["updates"]

    assert [stamp_of(message) for message in received] == [update["stamp_ns"] for update in updates]
    assert 230 < len(updates) < 250
    for name in ("mean", "covariance", "probability", "log_marginal"):
        live, replayed = [getattr(m, name) for m in received], [np.ravel(u[name]) for u in updates]
        np.testing.assert_allclose(np.reshape(live, (len(updates), -1)), replayed, rtol=1e-9, atol=1e-12)
    states = [getattr(Posterior, State(u["state"]).name) for u in updates]
    assert [m.state for m in received] == states
    assert [m.reason for m in received] == [u["reason"] for u in updates]
    assert [m.converged for m in received] == [u["converged"] for u in updates]


def test_a_clock_that_is_set_back_resets_the_belief_in_a_replay_as_live(tmp_path):
    sweep, scan, scene = unseen_sweep(rate=50.0), simulate_scan("bump", 1), shipped_scene("bump")
    first = [
        ("strain", 20 * k, strain(9000 + 20 * k, ("index", "middle"), strain=sweep.strain[k]))
        for k in range(60)
    ]
    poses = [("palm_pose", 20 * k + 5, pose(9000 + 20 * k, x=sweep.position[k, 0])) for k in range(60)]
    second = [(topic, 1200 + at, earlier(message, 5000)) for topic, at, message in first + poses]
    happened = sorted([*first, *poses, *second], key=lambda one: one[1])
    recording = read_bag(write_bag(tmp_path / "bag", happened), scene, by_status=False)

    def localizer() -> Localizer:
        quick, rng = Configuration(cell=1.0), np.random.default_rng(7)
        return build_localizer(scan, scene, quick, rng, calibration=CALIBRATION)

    online, session = OnlineLocalizer(localizer(), 0.1, ScanRange.of(scan, scene)), Session(scene.axes)
    reader, live = StrainReader(scene), []
    for topic, _, message in happened:
        if topic == "strain":
            session.add_strain(bag_stamp_of(message), reader.read(message))
        else:
            place = message.pose.position
            session.add_pose(bag_stamp_of(message), np.array([place.x, place.y]))
        live += online.take(session.take())
    replayed = replay(localizer(), recording)
    assert [len(one) for one in replayed] == [60, 60]
    assert [each.stamp_ns for each in live] == [stamp for one in replayed for stamp in one.stamp_ns.tolist()]
    np.testing.assert_array_equal(
        [each.mean for each in live], np.concatenate([one.mean for one in replayed])
    )
    assert [each.state for each in live] == [state for one in replayed for state in one.state]


def earlier(message: Any, ms: int) -> Any:
    """A message with an earlier stamp."""
    stamp_ns = bag_stamp_of(message) - ms * 1_000_000
    stamp = replace(message.header.stamp, sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return replace(message, header=replace(message.header, stamp=stamp))
