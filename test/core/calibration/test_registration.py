"""Registration error, from the errors of held-out sweeps."""

import numpy as np
import pytest
from support.scans import slides

from tactile_localizer.core.calibration.registration import registration_std
from tactile_localizer.core.calibration.trials import Outcome
from tactile_localizer.core.factory import learn
from tactile_localizer.core.geometry.motion import YAW_LEVER
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Axis, Phalanx, Scene

LENGTH = 0.05
SCENE = Scene("cloth", (Axis("x", 0.0, LENGTH),), (Phalanx("index", (0.0,)),))
SHEET = Scene("sheet", (Axis("x", 0.0, 0.04), Axis("yaw", -0.2, 0.2)), (Phalanx("index", (0.0, 0.0)),))
PRIOR, ERRORS = 0.0015, 5.0


def outcome(error: tuple[float, float], spread: tuple[float, float]) -> Outcome:
    """A sweep on the map, in m and rad."""
    return Outcome(0, True, 0.0, True, False, 1.0, 1.0, error, spread)


def cloth(shift: float, repeats: int) -> Scan:
    """Slides over waves of 10 to 40 mm, whose positions are off by ``shift`` m to either side."""
    rng, x = np.random.default_rng(0), np.arange(0.0, LENGTH, 0.0005)
    waves, phase = np.linspace(150.0, 600.0, 8), np.arange(8.0)
    off = shift * (1.0 - 2.0 * (np.arange(repeats) % 2))
    strain = [
        10.0 * np.sin((x[:, None] + each) * waves + phase) + rng.standard_normal((len(x), 8)) for each in off
    ]
    return slides(SCENE, x, strain)


def test_shifted_sweeps_give_the_registration_error() -> None:
    registration = {shift: float(learn(cloth(shift, 4), SCENE).registration_std[0]) for shift in (0.0, 0.003)}
    assert registration[0.0] < 0.0011
    # Held out, a sweep is localized between the others, half of which are shifted as it is.
    assert 0.0015 < registration[0.003] < 0.004


def test_a_single_sweep_gets_the_prior_of_the_registration_error() -> None:
    assert learn(cloth(0.0, 1), SCENE).registration_std == pytest.approx(PRIOR)


def test_the_registration_error_of_a_few_sweeps_is_near_its_prior() -> None:
    std, sweeps = 0.001, 7
    along, turned = registration_std(SHEET, [outcome((std, 0.0), (1e-6, 1e-6))] * sweeps)
    expected = np.sqrt((ERRORS * PRIOR**2 + np.array([sweeps * std**2, 0.0])) / (ERRORS + sweeps))
    np.testing.assert_allclose([along, YAW_LEVER * turned], expected, rtol=1e-3)


def test_what_a_belief_explains_of_its_error_is_no_registration_error() -> None:
    """So sweeps that do not know where they are leave the prior."""
    open_ones = [outcome((0.01, 0.1), (1.0, 10.0))] * 7
    np.testing.assert_allclose(registration_std(SHEET, open_ones), [PRIOR, PRIOR / YAW_LEVER], rtol=1e-3)
    half, all_of_it = (
        registration_std(SHEET, [outcome((0.004, 0.0), (spread, 0.1))] * 40)[0] for spread in (0.004, 0.0)
    )
    assert half < 0.6 * all_of_it
