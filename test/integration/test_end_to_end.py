"""From frames on a bus and palm poses to a converged position, with four installed nodes."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from support.sweeps import scene_of, stamp_of

from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.io.scene_file import save_scene
from tactile_localizer.sim.scan import TRAINING_SWEEPS

pytestmark = [pytest.mark.ros, pytest.mark.slow]

SPEED = 14.0
TEST_SWEEPS = 4
CONTACT_M = 0.024
"""Position along x at which the fingers reach the bump, m."""


class Hand:
    """The simulated hand, moved by the test."""

    def __init__(self, probe: Any) -> None:
        from geometry_msgs.msg import PoseStamped
        from rclpy.qos import DurabilityPolicy, QoSProfile
        from std_msgs.msg import Bool

        self.probe = probe
        latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.active = probe.listen(Bool, "simulator/sweep_active", latched)
        self.truth = probe.listen(PoseStamped, "simulator/ground_truth", 1000)

    def call(self, service: str) -> Any:
        from std_srvs.srv import Trigger

        answer = self.probe.call(Trigger, service)
        assert answer.success, f"{service}: {answer.message}"
        return answer

    def sweep(self) -> None:
        self.active.clear()
        self.call("simulator/sweep")
        self.probe.until(
            lambda: True in (seen := [message.data for message in self.active]) and not seen[-1],
            "the end of a sweep",
        )

    def localize(self) -> None:
        """Select sweeps over hanging material from unknown positions."""
        from rcl_interfaces.srv import SetParameters
        from rclpy.parameter import Parameter

        mode = Parameter("mode", value="localize").to_parameter_msg()
        answer = self.probe.call(
            SetParameters, "simulator/set_parameters", SetParameters.Request(parameters=[mode])
        )
        assert answer.results[0].successful

    def truth_at(self, stamps_ns: list[int]) -> np.ndarray:
        """True palm positions, (n, 2), m."""
        known = [stamp_of(message) for message in self.truth]
        places = np.array([[m.pose.position.x, m.pose.position.y] for m in self.truth])
        return np.stack([np.interp(stamps_ns, known, column) for column in places.T], axis=1)


@pytest.fixture
def system(node_process: Callable[..., Any], simulated_can: dict[str, Any], tmp_path: Any) -> dict[str, Any]:
    bus = {
        "interface": simulated_can["interface"],
        "channel": simulated_can["channel"],
        "bus_options": [f"port={simulated_can['port']}"],
    }
    save_scene(scene_of("bump"), tmp_path / "scene.yaml")
    simulated = {"speed": SPEED, "load_cell_rate_hz": 20.0, "pose_rate_hz": 15.0}
    return {
        "simulator": node_process("simulator_node", {"feature": "bump", **simulated, **bus}),
        "driver": node_process("driver_node", {"tare_file": tmp_path / "tare.yaml", **bus}),
        "mapping": node_process(
            "mapping_node", {"scene_file": tmp_path / "scene.yaml", "scan_file": tmp_path / "scan.db"}
        ),
    }


def scan(hand: Hand) -> None:
    """Record the training sweeps and wait until the status has them all."""
    from tactile_localizer.msg import ScanStatus

    statuses = hand.probe.listen(ScanStatus, "mapping/status")
    for _ in range(TRAINING_SWEEPS):
        hand.call("simulator/prepare")
        hand.call("mapping/start_sweep")
        hand.sweep()
        hand.call("mapping/end_sweep")
    hand.probe.until(lambda: statuses and statuses[-1].sweeps == TRAINING_SWEEPS, "the scan's status")
    assert statuses[-1].coverage > 0.9


def localize_once(hand: Hand, posteriors: list[Any]) -> tuple[float, bool]:
    """Mean error after contact of a sweep from an unknown start, m, and whether it converged."""
    from std_srvs.srv import Empty

    hand.call("simulator/prepare")
    ready_ns = time.time_ns()
    hand.probe.until(lambda: stamp_of(posteriors[-1]) > ready_ns, "the filter to keep up")
    hand.probe.call(Empty, "filter/reinitialize_global_localization")
    posteriors.clear()
    hand.truth.clear()
    hand.sweep()
    last_ns = stamp_of(hand.truth[-1])
    hand.probe.until(lambda: stamp_of(posteriors[-1]) >= last_ns, "the sweep's last posterior")
    received = [m for m in posteriors if stamp_of(m) <= last_ns]
    assert not any(m.stale for m in received)
    assert max(m.covariance_trace for m in received) > 1e-4, "the initial belief is uniform"
    truth = hand.truth_at([stamp_of(m) for m in received])
    error = np.linalg.norm([m.mean for m in received] - truth, axis=1)
    return float(error[truth[:, 0] > CONTACT_M].mean()), received[-1].converged


def test_scan_then_localize_from_unknown_positions(
    system: dict[str, Any], node_process: Callable[..., Any], probe: Any, tmp_path: Any
) -> None:
    from rclpy.qos import qos_profile_sensor_data

    from tactile_localizer.msg import Posterior, StrainVectors

    hand = Hand(probe)
    strains = probe.listen(StrainVectors, "strain", qos_profile_sensor_data)
    probe.until(lambda: strains, "the driver's strain")
    scan(hand)
    assert system["mapping"].stop() == 0
    with ScanStore.open(tmp_path / "scan.db") as store:
        assert len(store.load()) > 100 * TRAINING_SWEEPS

    parameters = {"scan_file": tmp_path / "scan.db", "cell": 0.5, "stale_timeout_s": 10.0}
    system["filter"] = node_process("filter_node", parameters)
    posteriors = probe.listen(Posterior, "filter/posterior", 1000)
    probe.until(lambda: posteriors, "the filter", timeout_s=60.0)
    hand.localize()
    errors, believed = zip(*(localize_once(hand, posteriors) for _ in range(TEST_SWEEPS)), strict=True)
    assert np.median(errors) < 0.004, f"errors after contact: {errors} m"
    assert sum(believed) >= TEST_SWEEPS / 2
    for name, process in system.items():
        if name != "mapping":
            assert process.stop() == 0, f"{name}: {process.output}"
        assert "Traceback" not in process.output, name
