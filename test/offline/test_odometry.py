"""Odometry from true positions."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tactile_localizer.io.recording import RecordedSweep, Recording
from tactile_localizer.offline.odometry import EXACT, SIMULATED, travelled, with_odometry
from tactile_localizer.scene import Axis, Phalanx, Scene

SCENE = Scene(
    "strip", (Axis("x", 0.0, 1.0, 0.004), Axis("y", 0.0, 1.0, 0.001)), (Phalanx("index", (0.0, 0.0)),)
)


def recording(*lengths: int, step: float = 0.001) -> Recording:
    sweeps = []
    for number, n in enumerate(lengths):
        position = np.column_stack([0.3 + step * np.arange(n), np.full(n, 0.5)])
        strain = np.arange(n)[:, None] + np.zeros(8)
        stamps = np.arange(n, dtype=np.int64) * 10**7
        sweeps.append(RecordedSweep(number, stamps, position, strain, np.zeros((n, 1), np.uint8)))
    return Recording("strip.csv", tuple(sweeps))


def test_exact_odometry_has_true_displacements_without_the_position() -> None:
    (sweep,) = with_odometry(recording(50), SCENE, np.random.default_rng(0), EXACT).sweeps
    np.testing.assert_array_equal(sweep.position[0], [0.0, 0.0])
    np.testing.assert_allclose(np.diff(sweep.position, axis=0), np.diff(sweep.truth, axis=0), atol=1e-15)


@pytest.mark.parametrize("step", [0.001, 0.0001])
def test_odometry_noise_does_not_depend_on_the_sample_rate(step: float) -> None:
    n = round(0.04 / step) + 1
    noisy = with_odometry(recording(*[n] * 400, step=step), SCENE, np.random.default_rng(0), SIMULATED)
    ends = np.array([s.position[-1] - (s.truth[-1] - s.truth[0]) for s in noisy.sweeps])
    expected = np.array([0.004, 0.001]) * math.sqrt(0.04)
    np.testing.assert_allclose(ends.std(axis=0), expected, rtol=0.12)
    np.testing.assert_allclose(ends.mean(axis=0), 0.0, atol=4 * expected.max() / 20)


def test_a_sweep_without_samples_stays_empty() -> None:
    (sweep,) = with_odometry(recording(0), SCENE, np.random.default_rng(0), SIMULATED).sweeps
    assert sweep.position.shape == (0, 2)


def test_yaw_is_followed_along_the_shortest_arc() -> None:
    scene = Scene("disc", (Axis("yaw", -math.pi, math.pi),), (Phalanx("index", (0.0,)),))
    turned = replace(recording(3).sweeps[0], position=np.array([[3.1], [-3.1], [3.1]]))
    odometry = with_odometry(Recording("", (turned,)), scene, np.random.default_rng(0), EXACT)
    np.testing.assert_allclose(odometry.sweeps[0].position[:, 0], [0.0, 2 * math.pi - 6.2, 0.0], atol=1e-12)


def test_travel_is_the_sum_of_the_steps() -> None:
    way = travelled(SCENE, np.array([[0.0, 0.0], [0.003, 0.004], [0.0, 0.0]]))
    np.testing.assert_allclose(way, [0.0, 0.005, 0.01])
