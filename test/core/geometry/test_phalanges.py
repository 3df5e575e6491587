"""Phalanges turn with the palm: T_material_phalanx = T_material_palm @ T_palm_phalanx."""

import math

import numpy as np
import pytest

from tactile_localizer.core.geometry.phalanges import phalanx_positions
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
