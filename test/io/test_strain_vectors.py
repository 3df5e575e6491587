"""Selection of the phalanges of a scene from strain vectors."""

import numpy as np
import pytest

from tactile_localizer.errors import MeasurementError, SceneError
from tactile_localizer.scene import Axis, Phalanx, Scene

pytestmark = pytest.mark.ros

AXES = (Axis("x", 0.0, 0.05),)
SCENE = Scene("mixed", AXES, (Phalanx("thumb", (0.0,), 3), Phalanx("index", (0.0,), 19)))


def message(size=30, status=(0, 1, 2), channels=(19, 8, 3), sequence=()):
    from tactile_localizer.msg import StrainVectors

    return StrainVectors(
        phalanges=["index", "middle", "thumb"],
        strain=np.arange(float(size)).tolist(),
        status=list(status),
        channels=list(channels),
        sequence=list(sequence),
    )


def reader(scene=SCENE):
    from tactile_localizer.io.strain_vectors import StrainReader

    return StrainReader(scene)


def test_phalanges_of_the_scene_are_selected():
    strain, status = reader().read(message())
    np.testing.assert_array_equal(strain, [27, 28, 29, *range(19)])
    assert status.tolist() == [2, 0]


def test_a_change_of_channels_is_followed():
    own = reader()
    own.read(message())
    with pytest.raises(SceneError, match="expected 3 channels, got 8"):
        own.read(message(24, channels=()))
    own.read(message())


@pytest.mark.parametrize(
    "wrong", [{"size": 29}, {"status": (0, 0)}, {"channels": (19, 8)}, {"channels": (19, 8, 3, 1)}]
)
def test_inconsistent_lengths_are_rejected(wrong):
    with pytest.raises(MeasurementError, match="strain vector of 3 phalanges"):
        reader().read(message(**wrong))


@pytest.mark.parametrize(
    ("sequences", "lost"),
    [((7, 8, 11, 12), 2), ((7, 9, 0, 1, 3), 2), ((900, 0, 901, 1, 902, 2), 0)],
    ids=["gap", "restart", "two publishers"],
)
def test_gaps_of_the_sequence_are_lost_vectors(sequences, lost):
    own = reader()
    for sequence in sequences:
        own.read(message(sequence=(sequence, sequence, sequence)))
    assert own.lost == lost
