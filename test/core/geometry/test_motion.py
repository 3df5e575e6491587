"""The motion model: displacement of the arm, and noise that grows with the travel."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.scans import scene

from tactile_localizer.core.geometry.motion import YAW_LEVER, MotionModel


def test_sampled_states_have_the_modelled_moments():
    model, rng = MotionModel(scene(3)), np.random.default_rng(0)
    states = np.full((200_000, 3), [0.01, 0.02, 0.1])
    moved = model.sample(states, np.array([0.005, -0.003, 0.2]), 0.04, rng)
    expected = np.array([0.003, 0.001, 0.05]) * math.sqrt(0.04)
    np.testing.assert_allclose(moved.mean(axis=0), [0.015, 0.017, 0.3], atol=5e-5)
    np.testing.assert_allclose(moved.std(axis=0), expected, rtol=0.01)
    np.testing.assert_allclose(model.variance(0.04), expected**2)


@given(st.lists(st.lists(st.floats(-1e6, 1e6), min_size=3, max_size=3), min_size=1))
def test_travels_agree_with_travel(displacements):
    model = MotionModel(scene(3))
    each = [model.travel(np.array(displacement)) for displacement in displacements]
    np.testing.assert_array_equal(model.travels(np.array(displacements)), each)


def test_yaw_counts_by_its_lever():
    model = MotionModel(scene(3))
    assert model.travel(np.array([0.003, 0.004, 0.0])) == pytest.approx(0.005)
    assert model.travel(np.array([0.0, 0.0, 0.5])) == pytest.approx(0.5 * YAW_LEVER)


@given(before=st.floats(-math.pi, math.pi), turn=st.floats(-3.1, 3.1))
def test_a_displacement_in_yaw_takes_the_shortest_arc(before, turn):
    model = MotionModel(scene(3, full_turn=True))
    after = (before + turn + math.pi) % (2 * math.pi) - math.pi
    step = model.displacement(np.array([0.0, 0.0, before]), np.array([0.001, 0.0, after]))
    np.testing.assert_allclose(step, [0.001, 0.0, turn], atol=1e-9)
