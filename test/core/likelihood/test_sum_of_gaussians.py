"""The sum-of-Gaussians model (the paper's Eq. 4), conditional and joint."""

import math

import numpy as np
import pytest
from scipy.special import logsumexp
from support import densities
from support.scans import scan, scene

from tactile_localizer.core.likelihood.sum_of_gaussians import SumOfGaussians
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import MeasurementError, SceneError

WIDTHS = (np.array([0.003, 0.004, 0.15]), 0.05)


def setting(dimension=2, phalanges=2, pairs=150):
    of = scene(dimension, phalanges)
    return of, scan(np.random.default_rng(1), of, pairs)


@pytest.mark.parametrize("place", [(0.02, 0.03), (0.0, 0.0), (-1.0, 5.0)])
def test_the_conditional_form_integrates_to_one(place):
    of, made = setting()
    model, state = SumOfGaussians(made, of, *widths()), np.array(place)
    log_near = -0.5 * np.sum(((made.states - state) / widths()[0]) ** 2, axis=1)
    shares = np.exp(log_near - logsumexp(log_near))

    def near(rng):
        return made.strain[rng.choice(len(made), p=shares)] + WIDTHS[1] * rng.standard_normal(16)

    def log_density_near(measured):
        squared = np.sum(((measured - made.strain) / WIDTHS[1]) ** 2, axis=1)
        return logsumexp(np.log(shares + 1e-300) - 0.5 * squared) - 8 * math.log(2 * math.pi * WIDTHS[1] ** 2)

    total = densities.integral(
        lambda measured: float(model.log_likelihood(state[None], measured)[0]),
        near,
        log_density_near,
        densities.background(made.strain, WIDTHS[1]),
    )
    assert total == pytest.approx(1.0, abs=0.05)


def widths(dimension=2):
    return WIDTHS[0][:dimension], WIDTHS[1]


def test_poses_a_turn_away_are_the_same():
    of = scene(3, full_turn=True)
    made = scan(np.random.default_rng(1), of, 300)
    turned = Scan(
        made.states + np.array([0, 0, 4 * math.pi]), made.strain, made.sweep, made.axes, made.phalanges
    )
    states, measured = made.states[:20], made.strain[0]
    one, other = (SumOfGaussians(s, of, *widths(3)) for s in (made, turned))
    np.testing.assert_allclose(
        one.log_likelihood(states, measured),
        other.log_likelihood(states + np.array([0, 0, 2 * math.pi]), measured),
        atol=1e-3,
    )


def test_a_scene_with_more_than_the_scan_is_refused():
    _, made = setting(2, 1)
    with pytest.raises(SceneError, match="phalanx 'middle' of scene 'test': expected one of index"):
        SumOfGaussians(made, scene(2, 2), *widths())
    with pytest.raises(SceneError, match="axis 'yaw'"):
        SumOfGaussians(made, scene(3, 1), *widths(3))


@pytest.mark.parametrize(
    ("strain", "present"),
    [
        (np.zeros(8), None),
        (np.full(16, np.nan), None),
        (np.full(16, np.inf), np.array([True, False])),
        (np.zeros(16), np.array([False, False])),
        (np.zeros(16), np.array([True])),
    ],
)
def test_an_unusable_strain_is_refused(strain, present):
    of, made = setting()
    with pytest.raises(MeasurementError):
        SumOfGaussians(made, of, *widths()).log_likelihood(np.zeros((3, 2)), strain, present)
