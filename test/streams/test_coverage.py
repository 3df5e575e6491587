"""Coverage is the fraction of the bounds within one sweep distance of a pair."""

import numpy as np

from tactile_localizer.scene import Axis, Phalanx, Scene
from tactile_localizer.streams.coverage import Coverage


def scene_of(*axes: Axis) -> Scene:
    return Scene("scene", axes, (Phalanx("index", (0.0,) * len(axes)),))


SQUARE = scene_of(Axis("x", 0.0, 0.1), Axis("y", 0.0, 0.1))


def test_one_line_covers_a_band_of_twice_the_distance():
    coverage = Coverage(SQUARE, distance_m=0.01)
    x = np.linspace(0, 0.1, 500)
    coverage.add(np.column_stack([x, np.full_like(x, 0.05)]))
    assert abs(coverage.fraction - 0.2) <= 0.051


def test_lines_one_distance_apart_cover_everything():
    coverage = Coverage(SQUARE, distance_m=0.005)
    x = np.linspace(0, 0.1, 500)
    shares = []
    for y in np.arange(0, 0.1001, 0.005):
        coverage.add(np.column_stack([x, np.full_like(x, y)]))
        shares.append(coverage.fraction)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_yaw_has_its_own_distance():
    coverage = Coverage(scene_of(Axis("x", 0.0, 0.01), Axis("yaw", -1.0, 1.0)), 0.02, distance_rad=0.2)
    coverage.add(np.array([[0.005, 0.0]]))
    assert abs(coverage.fraction - 0.2) < 0.11
