"""Anchors represent the whole map, and move with the palm."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.scans import scene

from tactile_localizer.core.geometry.anchors import Anchors
from tactile_localizer.scene import Scene

SCENES = [scene(1), scene(2), scene(3, full_turn=True)]
every_scene = pytest.mark.parametrize("of", SCENES, ids=["line", "plane", "turn"])
displacements = st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3)


@every_scene
@given(along=displacements)
def test_they_move_with_the_palm_and_return_at_the_opposite_bound(of: Scene, along: list[float]) -> None:
    anchors = Anchors(of)
    before, displacement = anchors.states, np.array(along[: of.dimension])
    left = anchors.move(displacement)
    turns = (anchors.states - before - displacement) / of.extent
    np.testing.assert_allclose(turns, np.rint(turns), atol=1e-9)
    # Round a full turn they have not left.
    np.testing.assert_array_equal(left, np.rint(turns)[:, ~of.wraps].any(axis=1))
    assert (anchors.states >= of.lower - 1e-9).all()
    assert (anchors.states <= of.upper + 1e-9).all()
    anchors.reset()
    np.testing.assert_array_equal(anchors.states, before)


@every_scene
def test_they_are_the_centres_of_equal_boxes_that_cover_the_scene(of: Scene) -> None:
    anchors = Anchors(of)
    for along, lower, upper, pitch in zip(
        anchors.states.T, of.lower, of.lower + of.extent, anchors.pitch, strict=True
    ):
        places = np.unique(along.round(9))
        np.testing.assert_allclose(places, np.arange(lower + 0.5 * pitch, upper, pitch), atol=1e-8)
    assert len(anchors) * np.prod(anchors.pitch) == pytest.approx(np.prod(of.extent))
