"""Contact of a fingertip pad with the material."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_localizer.sim.contact import PAD_HALF_M, contact
from tactile_localizer.sim.material import MODES

WHOLE = ("bump", "snap", "grommet")


def at(feature, x, y=0.0, mode="taut"):
    x = np.atleast_1d(x)
    return np.stack(contact(feature, mode, x, np.broadcast_to(y, x.shape)))


@pytest.mark.parametrize("feature", WHOLE)
def test_far_from_the_feature_the_contact_is_flat(feature):
    bare = at("none", 0.0)
    for x, y in ((-18e-3, 0), (18e-3, 0), (0, 18e-3), (0, -18e-3), (0.3, 0), (0, -0.3)):
        np.testing.assert_allclose(at(feature, x, y), bare, atol=1e-4)


def test_the_bare_sheet_presses_on_the_middle():
    lift, x, y, slope_x, slope_y, friction = at("none", 0.0)[:, 0]
    np.testing.assert_allclose([lift, x, y, slope_x, slope_y], 0, atol=1e-9)
    assert friction == pytest.approx(0.4)


@given(x=st.floats(-18e-3, 18e-3), y=st.floats(-18e-3, 18e-3), feature=st.sampled_from(WHOLE))
def test_contact_with_a_round_feature_is_symmetric(x, y, feature):
    here, mirrored = at(feature, x, y)[:, 0], at(feature, x, -y)[:, 0]
    np.testing.assert_allclose(here * [1, 1, -1, 1, -1, 1], mirrored, atol=1e-6)


@given(
    x=st.floats(-18e-3, 18e-3),
    y=st.floats(-18e-3, 18e-3),
    feature=st.sampled_from(WHOLE),
    mode=st.sampled_from(MODES),
)
def test_the_centre_of_pressure_stays_on_the_pad(x, y, feature, mode):
    _, u, v, *_ = at(feature, x, y, mode)[:, 0]
    assert (u / PAD_HALF_M[0]) ** 2 + (v / PAD_HALF_M[1]) ** 2 <= 1
