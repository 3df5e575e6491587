"""The part of a scene in which a hand is localized."""

from dataclasses import replace

import numpy as np

from tactile_localizer.core.geometry.surroundings import surroundings
from tactile_localizer.scene import Axis, Phalanx, Scene


def test_a_sweep_is_localized_in_its_surroundings() -> None:
    """And up to a millimetre beyond the scan, but for yaw."""
    axes = (Axis("x", -1.0, 1.0), Axis("y", 0.0, 0.0301), Axis("yaw", -0.2, 0.2))
    scene = Scene("large", axes, (Phalanx("index", (0.0, 0.0, 0.0)),))
    near = surroundings(scene, np.array([[0.3, 0.02, -0.2], [0.4, 0.03, 0.2]]))
    np.testing.assert_allclose(near.lower, [0.25, 0.0, -0.2])
    np.testing.assert_allclose(near.upper, [0.45, 0.031, 0.2])
    part = surroundings(scene, np.array([[-2.0, 0.05, 0.0], [2.0, -0.05, 0.0]]))
    np.testing.assert_allclose([part.lower[:2], part.upper[:2]], [[-1.001, -0.001], [1.001, 0.0311]])
    turn = replace(scene, axes=(*axes[:2], Axis("yaw", -np.pi, np.pi)))
    assert surroundings(turn, np.zeros((1, 3))).upper[2] == np.pi
