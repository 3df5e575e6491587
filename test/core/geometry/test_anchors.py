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
    anchors.move(displacement)
    turns = (anchors.states - before - displacement) / of.extent
    np.testing.assert_allclose(turns, np.rint(turns), atol=1e-9)
    assert (anchors.states >= of.lower - 1e-9).all()
    assert (anchors.states <= of.upper + 1e-9).all()
    anchors.reset()
    np.testing.assert_array_equal(anchors.states, before)


@every_scene
@given(along=displacements, seed=st.integers(0, 2**32 - 1))
def test_a_state_is_in_the_box_whose_centre_is_nearest(of: Scene, along: list[float], seed: int) -> None:
    anchors = Anchors(of)
    anchors.move(np.array(along[: of.dimension]))
    states = of.lower + np.random.default_rng(seed).random((50, of.dimension)) * of.extent
    away = (states - anchors.states[anchors.index(states)]) / of.extent
    away = (away - np.rint(away)) * of.extent
    assert (np.abs(away) <= 0.5 * anchors.pitch + 1e-9).all()
    np.testing.assert_array_equal(anchors.index(anchors.states), np.arange(len(anchors)))
