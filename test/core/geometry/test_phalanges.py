"""Phalanges turn with the palm: T_material_phalanx = T_material_palm @ T_palm_phalanx."""

import math

import numpy as np
import pytest
from support.turned import SCENE, turned_scan

from tactile_localizer.core.geometry.phalanges import phalanges_on_feature, phalanx_positions
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Axis, Phalanx, Scene


def transform(x: float, y: float, yaw: float) -> np.ndarray:
    """T_target_source of a pose in the plane, (3, 3)."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([[cos, -sin, x], [sin, cos, y], [0.0, 0.0, 1.0]])


def test_phalanx_position_is_a_product_of_transforms() -> None:
    scene = Scene(
        "turned",
        (Axis("yaw", -math.pi, math.pi), Axis("x", 0.0, 1.0), Axis("y", 0.0, 1.0)),
        (Phalanx("index", (0.3, 0.01, 0.02)),),
    )
    for yaw, x, y in np.random.default_rng(0).uniform(-1.0, 1.0, (20, 3)):
        T_material_phalanx = transform(x, y, yaw) @ transform(0.01, 0.02, 0.3)
        placed = phalanx_positions(scene, scene.phalanges[0], np.array([[yaw, x, y]]))[0]
        np.testing.assert_allclose(placed[1:], T_material_phalanx[:2, 2], atol=1e-12)
        assert placed[0] == pytest.approx(math.atan2(T_material_phalanx[1, 0], T_material_phalanx[0, 0]))


def bump_strength(scan: Scan, phalanx: int) -> np.ndarray:
    """Distance of the strain of a phalanx from that of featureless material, (N,) V."""
    own = scan.layout.slices[phalanx]
    return np.asarray(np.linalg.norm(scan.strain[:, own] - np.median(scan.strain[:, own], axis=0), axis=1))


def centre(strength: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Mean of places (..., d), weighted by the squares of the strongest strains (...): (2,) m."""
    weights = np.where(strength > 0.3 * strength.max(), strength**2, 0.0).ravel()
    return weights @ places.reshape(len(weights), -1)[:, :2] / weights.sum()


@pytest.mark.parametrize("yaw", [-0.2, 0.2])
def test_a_turned_hand_senses_the_feature_at_the_same_place(yaw: float) -> None:
    for number, phalanx in enumerate(SCENE.phalanges):
        straight, turned = (
            centre(bump_strength(scan, number), phalanx_positions(SCENE, phalanx, scan.states))
            for scan in (turned_scan((0.0,)), turned_scan((yaw,)))
        )
        np.testing.assert_allclose(turned, straight, atol=0.4e-3)


@pytest.mark.parametrize("yaw", [-0.2, 0.0, 0.2])
def test_a_turned_hand_senses_nothing_outside_the_region(yaw: float) -> None:
    scan = turned_scan((yaw,))
    on = phalanges_on_feature(SCENE, scan.states)
    for number in range(len(SCENE.phalanges)):
        strength = bump_strength(scan, number)
        assert strength[~on[:, number]].max() < 0.25 * strength.max()
