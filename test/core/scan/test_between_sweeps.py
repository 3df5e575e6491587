"""Pairs interpolated between the sweeps of a scan."""

import numpy as np
import pytest

from tactile_localizer.core.scan.between_sweeps import (
    with_interpolated_sweeps,
)
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.spacing import divided, nearest_of_other_sweeps
from tactile_localizer.errors import ScanError
from tactile_localizer.scene import Axis, Phalanx, Scene

SIDE = 0.02
PLANE = Scene(
    "plane", (Axis("x", 0.0, SIDE, 0.002), Axis("y", 0.0, SIDE, 0.002)), (Phalanx("index", (0.0, 0.0)),)
)
LINE = Scene("line", (Axis("x", 0.0, SIDE, 0.002),), (Phalanx("index", (0.0,)),))


def sloping(states: np.ndarray) -> np.ndarray:
    """Strains (N, 8) that depend linearly on the state."""
    return states @ np.arange(2.0, 2.0 + 8 * states.shape[1]).reshape(states.shape[1], 8)


def lines(spacing: float = 0.002, step: float = 0.00005) -> Scan:
    along, across = np.arange(0.0, SIDE, step), np.arange(0.0, SIDE, spacing)
    states = np.stack(np.meshgrid(along, across, indexing="xy"), axis=-1).reshape(-1, 2)
    return Scan(
        states, sloping(states), np.repeat(np.arange(len(across)), len(along)), ("x", "y"), ("index",)
    )


def test_linear_strains_are_interpolated_exactly_between_sweeps() -> None:
    dense = with_interpolated_sweeps(lines(), PLANE)
    np.testing.assert_allclose(dense.strain, sloping(dense.states), atol=1e-12)


def test_pairs_fill_the_gaps_between_sweeps() -> None:
    scan = lines()
    dense = with_interpolated_sweeps(scan, PLANE)
    across = np.unique(np.round(dense.states[:, 1], 9))
    assert np.diff(across).max() <= 0.001
    assert across[0] == scan.states[:, 1].min()
    assert across[-1] == pytest.approx(scan.states[:, 1].max())


def test_pairs_are_also_interpolated_across_a_sweep() -> None:
    scan = lines()
    odd = scan.sweep == 5
    scan = Scan(
        scan.states, np.where(odd[:, None], 100.0, scan.strain), scan.sweep, scan.axes, scan.phalanges
    )
    dense = with_interpolated_sweeps(scan, PLANE)
    near = (np.abs(dense.states[:, 1] - 0.01) < 0.0005) & (np.abs(dense.states[:, 0] - 0.01) < 0.0005)
    found = dense.strain[near, 0]
    assert (found > 50.0).any()
    assert (found < 1.0).any()


def test_repeats_of_one_line_are_unchanged() -> None:
    x = np.tile(np.linspace(0.0, SIDE, 400), 3)[:, None]
    scan = Scan(x, sloping(x), np.repeat([0, 1, 2], 400), ("x",), ("index",))
    assert with_interpolated_sweeps(scan, LINE) is scan


@pytest.mark.parametrize("pairs", [1, 2, 50])
def test_a_single_sweep_is_unchanged(pairs: int) -> None:
    states = np.linspace(0.001, 0.019, pairs)[:, None] * [1.0, 0.5]
    scan = Scan(states, sloping(states), np.zeros(pairs, dtype=int), ("x", "y"), ("index",))
    assert with_interpolated_sweeps(scan, PLANE) is scan


def test_yaw_is_interpolated_along_the_shortest_arc() -> None:
    scene = Scene(
        "turn",
        (Axis("x", 0.0, SIDE, 0.002), Axis("yaw", -np.pi, np.pi, 0.1)),
        (Phalanx("index", (0.0, 0.0)),),
    )
    assert scene.wraps[1]
    x = np.arange(0.0, SIDE, 0.00005)
    yaws = np.radians([0.0, 20.0, 40.0])
    states = np.array([(place, yaw) for yaw in yaws for place in x])
    scan = Scan(states, sloping(states), np.repeat([0, 1, 2], len(x)), ("x", "yaw"), ("index",))
    dense = with_interpolated_sweeps(scan, scene)
    assert len(dense) > len(x)
    assert (np.abs(dense.states[:, 1] - np.radians(20.0)) < np.radians(20.1)).all()


def test_neighbours_are_in_another_sweep() -> None:
    scan = lines(spacing=0.004)
    own, nearest, distance = nearest_of_other_sweeps(scan, PLANE)
    assert (scan.sweep[own] != scan.sweep[nearest]).all()
    np.testing.assert_allclose(distance, 0.004 / SIDE)


def test_a_single_sweep_is_split_in_two() -> None:
    assert set(divided(np.zeros(10, dtype=int))) == {0, 1}
    np.testing.assert_array_equal(divided(np.array([3, 3, 5])), [3, 3, 5])


def test_a_scan_of_one_pair_is_refused() -> None:
    with pytest.raises(ScanError, match="expected at least 2 pairs, found 1"):
        nearest_of_other_sweeps(lines().select(np.array([0])), PLANE)
