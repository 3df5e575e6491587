"""The tactile map is interpolated from neighbouring pairs, and empty far from them."""

import numpy as np
import pytest

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tactile_map import make_map
from tactile_localizer.scene import Axis, Phalanx, Scene

SQUARE = Scene("s", (Axis("x", 0.0, 0.05), Axis("y", 0.0, 0.04)), (Phalanx("index", (0.0, 0.0)),))
LINE = Scene("l", (Axis("x", 0.0, 0.5),), (Phalanx("index", (0.0,)),))


def plane(states: np.ndarray) -> np.ndarray:
    return 3.0 + 10 * states[:, 0] - 20 * states[:, 1]


def raster(lines: np.ndarray, scene: Scene = SQUARE, value=plane) -> Scan:
    x = np.linspace(scene.lower[0], scene.upper[0], 400)
    states = np.concatenate([np.column_stack([x, np.full_like(x, y)]) for y in lines])
    strain = value(states)[:, None] * np.arange(1, 9)
    return Scan(states, strain, np.repeat(np.arange(len(lines)), len(x)), ("x", "y"), ("index",))


def test_a_plane_is_reproduced_between_the_sweeps():
    tactile_map = make_map(raster(np.arange(0, 0.0401, 0.0025)), SQUARE)
    assert tactile_map.covered.all()
    nodes = np.stack(np.meshgrid(*tactile_map.nodes, indexing="ij"), axis=-1)
    expected = plane(nodes.reshape(-1, 2)).reshape(nodes.shape[:2])
    inner = np.s_[5:-5, 5:-5]
    np.testing.assert_allclose(tactile_map.values[inner][..., 0], expected[inner], atol=0.02)
    np.testing.assert_allclose(tactile_map.values[..., 7], 8 * tactile_map.values[..., 0])


def test_nodes_are_equally_spaced_and_reach_the_bounds():
    tactile_map = make_map(raster(np.arange(0, 0.0401, 0.0025)), SQUARE)
    assert tactile_map.values.shape == (120, 96, 8)
    np.testing.assert_allclose([nodes[[0, -1]] for nodes in tactile_map.nodes], [[0, 0.05], [0, 0.04]])


def test_nodes_far_from_all_sweeps_have_no_value():
    lines = np.arange(0.0, 0.0081, 0.001)
    tactile_map = make_map(raster(np.concatenate([lines, 0.04 - lines])), SQUARE)
    y = tactile_map.nodes[1]
    np.testing.assert_array_equal(tactile_map.covered.all(axis=0), tactile_map.covered.any(axis=0))
    covered = tactile_map.covered[0]
    assert covered[(y < 0.008) | (y > 0.032)].all()
    assert not covered[(y > 0.01) & (y < 0.03)].any()


def test_the_background_of_a_phalanx_is_subtracted():
    scan = raster(np.arange(0, 0.0401, 0.0025), value=lambda s: 5.0 + (s[:, 0] > 0.045))
    tactile_map = make_map(scan, SQUARE)
    shown = tactile_map.phalanx("index")[..., 0]
    assert np.median(shown) == 0.0
    np.testing.assert_allclose(shown[-1], 1.0)


def test_of_three_axes_the_first_two_are_shown():
    scene = Scene("s", (*SQUARE.axes, Axis("yaw", -1.0, 1.0)), (Phalanx("index", (0.0,) * 3),))
    flat = raster(np.arange(0, 0.0401, 0.0025))
    states = np.column_stack([flat.states, np.linspace(-1, 1, len(flat))])
    scan = Scan(states, flat.strain, flat.sweep, ("x", "y", "yaw"), ("index",))
    assert make_map(scan, scene).axes == ("x", "y")


@pytest.mark.parametrize("pairs", [1, 2, 5])
def test_few_pairs_cover_only_their_surroundings(pairs):
    states = np.full((pairs, 2), 0.02) + 1e-4 * np.arange(pairs)[:, None]
    scan = Scan(states, np.ones((pairs, 8)), np.zeros(pairs, int), ("x", "y"), ("index",))
    tactile_map = make_map(scan, SQUARE)
    assert tactile_map.covered.any()
    assert not tactile_map.covered.all()
    np.testing.assert_allclose(tactile_map.values[tactile_map.covered], 1.0)
