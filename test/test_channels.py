"""Layout of a strain vector."""

import numpy as np
import pytest

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.errors import SceneError
from tactile_localizer.io.scene_file import scene_from_dict, scene_to_dict

MIXED = ChannelLayout((3, 8, 1))
SCENE = {
    "name": "mixed",
    "axes": {"x": {"bounds": [0.0, 0.1]}},
    "phalanges": {"index": {"offset": {"x": 0.01}, "channels": 3}, "middle": {}, "thumb": {"channels": 1}},
}


@pytest.mark.parametrize("counts", [(3, 8, 1), (8, 8), (5,)])
def test_reductions_go_over_the_channels_of_each_phalanx(counts):
    layout = ChannelLayout(counts)
    values = np.random.default_rng(0).normal(size=(4, layout.size))
    parts = layout.split(values)
    np.testing.assert_allclose(layout.sum(values), np.stack([p.sum(axis=1) for p in parts], axis=1))
    np.testing.assert_array_equal(
        layout.all(values > -1), np.stack([(p > -1).all(axis=1) for p in parts], axis=1)
    )
    assert layout.sum(values[0]).shape == (len(counts),)


def test_one_value_per_phalanx_is_expanded_to_its_channels():
    np.testing.assert_array_equal(
        MIXED.expand(np.array([True, False, True])), [True] * 3 + [False] * 8 + [True]
    )
    assert [MIXED.place(column) for column in (0, 2, 3, 10, 11)] == [(0, 1), (0, 3), (1, 1), (1, 8), (2, 1)]


def test_a_scene_gives_channels_per_phalanx():
    scene = scene_from_dict(SCENE)
    assert scene.layout == MIXED
    assert scene_from_dict(scene_to_dict(scene)) == scene
    assert "channels" not in scene_to_dict(scene)["phalanges"]["middle"]


@pytest.mark.parametrize("channels", [0, -1, 2.5, True, "many", 10**6])
def test_invalid_channel_counts_are_rejected(channels):
    with pytest.raises(SceneError, match="phalanx index"):
        scene_from_dict({**SCENE, "phalanges": {"index": {"channels": channels}}})
