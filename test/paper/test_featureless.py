"""The measurement model with separate featureless regions."""

import math

import numpy as np
import pytest
from scipy import stats
from support import densities
from support.scans import scan, scene, slides

from tactile_localizer.errors import SceneError
from tactile_localizer.paper.featureless import Featureless
from tactile_localizer.scene import Axis, Phalanx, Region, Scene

SCENE = scene(2, 2, Region((0.02, -math.inf), (0.04, math.inf)))
SCAN = scan(np.random.default_rng(0), SCENE, 600)
POSITION_STD, STRAIN_STD = np.array([0.002, 0.004]), 0.05


def inside(places):
    return (places[:, 0] >= 0.02) & (places[:, 0] <= 0.04)


def test_the_density_is_a_product_over_phalanges():
    states = 0.05 * np.random.default_rng(1).random((25, 2))
    expected = np.zeros(25)
    for phalanx, own in zip(SCENE.phalanges, SCENE.layout.slices, strict=True):
        pairs, places = SCAN.states + phalanx.offset, states + phalanx.offset
        strain, measured = SCAN.strain[:, own], SCAN.strain[17, own]
        off = strain[~inside(pairs)]
        covariance = np.cov(off.T, bias=True) * (1 + 1e-3 * np.eye(8)) + STRAIN_STD**2 * np.eye(8)
        (broad,) = densities.background(strain, STRAIN_STD)
        gaussian = stats.multivariate_normal(off.mean(axis=0), covariance).logpdf(measured)
        flat = np.logaddexp(gaussian, math.log(0.01) + broad.logpdf(measured)) - math.log(1.01)
        on = densities.sum_of_gaussians(pairs, strain, POSITION_STD, STRAIN_STD, places, measured)
        expected += np.where(inside(places), on, flat)
    found = Featureless(SCAN, SCENE, POSITION_STD, STRAIN_STD).log_likelihood(states, SCAN.strain[17])
    np.testing.assert_allclose(found, expected, atol=0.1)


def test_the_region_of_a_turned_phalanx_wraps():
    """Yaw of the phalanx = yaw of the palm + offset, wrapped."""
    rng = np.random.default_rng(0)
    yaw = 2 * math.pi * rng.random(800) - math.pi
    felt = 0.02 * rng.standard_normal((800, 8)) + np.exp(-0.5 * ((yaw[:, None] + 2.75) / 0.1) ** 2)
    place = np.linspace(-math.pi, math.pi - 1e-9, 200)
    found = []
    for turn in (0.0, 1.0):
        axes, region = (Axis("yaw", -math.pi, math.pi),), Region((-3.0,), (-2.5,))
        knob = Scene("knob", axes, (Phalanx("index", (turn,)),), region)
        palms, states = (np.angle(np.exp(1j * (at - turn))) for at in (yaw, place))
        model = Featureless(slides(knob, palms, [felt]), knob, 0.1, 0.05)
        found.append([model.log_likelihood(states[:, None], one) for one in (felt[3], np.full(8, 1.0))])
    np.testing.assert_allclose(found[1], found[0], atol=0.01)


@pytest.mark.parametrize(
    ("region", "message"),
    [
        (None, "scene plain: expected a feature region for the model featureless"),
        (Region((-1, -1), (1, 1)), "phalanx index on both sides of the feature region, all are inside"),
        (Region((0.5, 0), (0.6, 1)), "phalanx index on both sides of the feature region, all are outside"),
    ],
)
def test_a_scene_without_a_region_that_divides_it_is_refused(region, message):
    with pytest.raises(SceneError, match=message):
        Featureless(SCAN, Scene("plain", SCENE.axes, SCENE.phalanges, region), POSITION_STD, STRAIN_STD)
