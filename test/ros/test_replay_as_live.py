"""Replay of a bag without ROS gives the posteriors of the filter node."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader
from support.bags import START, pose, strain, write_bag
from support.sweeps import stamp_of, unseen_sweep

from tactile_localizer.cli import main
from tactile_localizer.core.hypotheses.convergence import State

pytestmark = pytest.mark.ros

GRID = {"cell": 1.0}
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
    from geometry_msgs.msg import PoseStamped
    from rclpy.serialization import deserialize_message

    from tactile_localizer.msg import Posterior, StrainVectors

    received = probe.listen(Posterior, "tactile_filter/posterior", 1000)
    kinds = {"/strain": StrainVectors, "/palm_pose": PoseStamped}
    publishers = {
        "/strain": probe.publisher(StrainVectors, "strain", probe.best_effort, timeout_s=60.0),
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


@pytest.mark.parametrize("choices", [GRID, PARTICLES], ids=["grid", "particles"])
def test_replay_equals_the_live_filter(
    tmp_path: Path, monkeypatch: Any, node_process: Any, probe: Any, scan_file: Path, choices: dict[str, Any]
) -> None:
    from tactile_localizer.msg import Posterior

    monkeypatch.chdir(tmp_path)
    bag = record(tmp_path / "bag")
    node = node_process("filter_node", {"scan_file": scan_file, "seed": 7, **choices})
    received = play(bag, probe)
    assert node.stop() == 0
    assert f" {len(received)} posteriors, " in node.output
    assert {tuple(m.axes) for m in received} == {("x", "y")}
    assert {m.header.frame_id for m in received} == {"material"}

    (tmp_path / "own.yaml").write_text(yaml.safe_dump(choices))
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
