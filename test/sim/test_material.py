"""Fields of the simulated features."""

import numpy as np
import pytest

from tactile_localizer.errors import ParameterError
from tactile_localizer.sim.material import FEATURES, MODES, surface

LINE = np.linspace(-20e-3, 20e-3, 401)
AT_ZERO = np.zeros_like(LINE)


@pytest.mark.parametrize("feature", FEATURES)
@pytest.mark.parametrize("mode", MODES)
def test_fields_are_finite_and_stiff_enough(feature, mode):
    fields = surface(feature, mode, LINE[:, None], LINE[None, :])
    assert fields.height.shape == fields.stiffness.shape == fields.friction.shape == (401, 401)
    assert np.all(np.isfinite(fields.height))
    assert np.all(fields.stiffness > 0)
    assert np.all((fields.friction > 0.1) & (fields.friction < 0.8))


def test_featureless_material_is_flat_in_every_mode():
    for mode in MODES:
        assert not np.any(surface("none", mode, LINE, AT_ZERO).height)


def test_features_differ_in_shape():
    bump, snap, grommet = (surface(f, "taut", LINE, AT_ZERO).height for f in ("bump", "snap", "grommet"))
    middle = len(LINE) // 2
    assert bump[middle] > 1e-3
    assert snap[middle] > 2e-3
    assert np.sum(snap > 1.5e-3) < np.sum(bump > 1e-3) / 2
    assert grommet[middle] < 0 < np.max(grommet)


def test_unknown_features_and_modes_are_refused():
    with pytest.raises(ParameterError, match=r"feature 'button': expected one of bump, snap"):
        surface("button", "taut", LINE, AT_ZERO)
    with pytest.raises(ParameterError, match=r"deformation mode 'torn': expected one of taut"):
        surface("bump", "torn", LINE, AT_ZERO)
