"""Palm poses are converted to positions on the scene's axes."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactile_localizer.errors import MeasurementError, ParameterError
from tactile_localizer.scene import Axis
from tactile_localizer.streams.palm_frame import PalmFrame

X = Axis("x", -10, 10)
Y = Axis("y", -10, 10)
YAW = Axis("yaw", -math.pi, math.pi)
LEVEL = (0.0, 0.0, 0.0, 1.0)


def test_a_pose_in_the_material_frame_is_not_transformed():
    quaternion = Rotation.from_euler("z", 0.3).as_quat()
    np.testing.assert_allclose(
        PalmFrame((YAW, Y, X)).position("material", (1, 2, 3), quaternion), [0.3, 2, 1]
    )
    np.testing.assert_array_equal(PalmFrame((Y,)).position("material", (1, 2, 3), (0, 0, 0, 0)), [2])


def test_a_pose_in_the_reference_frame_is_transformed():
    rng = np.random.default_rng(5)
    for _ in range(20):
        pose = np.concatenate([rng.normal(size=3), rng.uniform(-1.4, 1.4, 3)])
        material = Rotation.from_euler("xyz", pose[3:])
        place = rng.normal(size=3)
        palm = Rotation.from_euler("xyz", [0.2, -0.1, rng.uniform(-3, 3)])
        frame = PalmFrame((X, Y, YAW), reference_frame="base", material_pose=list(pose))
        found = frame.position("base", pose[:3] + material.apply(place), (material * palm).as_quat())
        heading = palm.apply([1, 0, 0])
        np.testing.assert_allclose(found, [*place[:2], math.atan2(heading[1], heading[0])], atol=1e-12)


def test_an_unknown_frame_is_refused():
    with pytest.raises(MeasurementError, match=r"palm pose frame 'map': expected 'material'$"):
        PalmFrame((X,)).position("map", (0, 0, 0), LEVEL)
    with pytest.raises(MeasurementError, match=r"palm pose frame '': expected 'sheet' or 'base'$"):
        PalmFrame((X,), "sheet", "base").position("", (0, 0, 0), LEVEL)


@pytest.mark.parametrize(
    ("place", "quaternion"),
    [
        ((math.nan, 0, 0), LEVEL),
        ((-1e200, 0, 0), LEVEL),
        ((0, 0, 0), (0, 0, 0, 0)),
        ((0, 0, 0), (math.nan,) * 4),
    ],
)
def test_a_pose_that_is_not_finite_is_refused(place, quaternion):
    with pytest.raises(MeasurementError, match="palm pose: expected finite x, yaw"):
        PalmFrame((X, YAW)).position("material", place, quaternion)


@pytest.mark.parametrize("pose", [[0.0] * 5, [0.0, 0.0, 0.0, 0.0, 0.0, math.nan]])
def test_an_invalid_material_pose_is_refused(pose):
    with pytest.raises(ParameterError, match="material_pose: expected x, y, z, roll, pitch, yaw"):
        PalmFrame((X,), reference_frame="base", material_pose=pose)
