"""The measurement model with separate featureless regions."""

import math

import numpy as np
import pytest
from scipy import stats
from support import densities

from tactile_localizer.core.likelihood.featureless import Featureless
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import SceneError
from tactile_localizer.scene import Axis, Phalanx, Region, Scene

REGION = Region((0.02, -math.inf), (0.04, math.inf))
SCENE = Scene(
    "bump",
    (Axis("x", 0.0, 0.05), Axis("y", 0.0, 0.05)),
    (Phalanx("index", (0.006, 0.0)), Phalanx("middle", (-0.006, 0.0))),
    REGION,
)
POSITION_STD, STRAIN_STD = np.array([0.002, 0.004]), 0.05


def felt(place: np.ndarray) -> np.ndarray:
    """Strain of a fingertip at (N, 2): a ramp up the feature, the same on both fingers, (N, 8)."""
    along = np.where(np.abs(place[:, :1] - 0.03) <= 0.01, (place[:, :1] - 0.02) / 0.02, 0.0)
    return along * np.linspace(0.5, 1.5, 8)


def made(seed=0, pairs=600, noise=0.03):
    rng = np.random.default_rng(seed)
    states = 0.05 * rng.random((pairs, 2))
    strain = np.concatenate([felt(states + np.array(p.offset)) for p in SCENE.phalanges], axis=1)
    return Scan(
        states,
        strain + noise * rng.standard_normal(strain.shape),
        np.arange(pairs) // 60,
        ("x", "y"),
        ("index", "middle"),
    )


def model(scan=None, scene=SCENE):
    return Featureless(made() if scan is None else scan, scene, POSITION_STD, STRAIN_STD)


def off_feature(scan, finger):
    """Mean and covariance of the strains of a finger off the feature."""
    place = scan.states + np.array(SCENE.phalanges[finger].offset)
    own = scan.strain[(place[:, 0] < 0.02) | (place[:, 0] > 0.04), 8 * finger : 8 * finger + 8]
    return own.mean(axis=0), np.cov(own.T, bias=True) * (1 + 1e-3 * np.eye(8)) + STRAIN_STD**2 * np.eye(8)


def test_the_density_is_a_product_over_phalanges():
    scan = made()
    states = 0.05 * np.random.default_rng(1).random((25, 2))
    measured = scan.strain[17]
    expected = np.zeros(25)
    for finger in range(2):
        offset, own = np.array(SCENE.phalanges[finger].offset), slice(8 * finger, 8 * finger + 8)
        broad = densities.background(scan.strain[:, own], STRAIN_STD)[0].logpdf(measured[own])
        mean, covariance = off_feature(scan, finger)
        off = np.logaddexp(
            stats.multivariate_normal(mean, covariance).logpdf(measured[own]), math.log(0.01) + broad
        ) - math.log(1.01)
        places = states + offset
        on = densities.sum_of_gaussians(
            scan.states + offset, scan.strain[:, own], POSITION_STD, STRAIN_STD, places, measured[own]
        )
        expected += np.where((places[:, 0] >= 0.02) & (places[:, 0] <= 0.04), on, off)
    np.testing.assert_allclose(model(scan).log_likelihood(states, measured), expected, atol=0.1)


def test_the_region_of_a_turned_phalanx_wraps():
    """Yaw of the phalanx = yaw of the palm + offset, wrapped."""
    rng = np.random.default_rng(0)
    region = Region((-3.0,), (-2.5,))
    yaw = rng.random((800, 1)) * 2 * math.pi - math.pi
    feels = 0.02 * rng.standard_normal((800, 8)) + np.exp(-0.5 * ((yaw + 2.75) / 0.1) ** 2)
    models = []
    for turn in (0.0, 1.0):
        scene = Scene("knob", (Axis("yaw", -math.pi, math.pi),), (Phalanx("index", (turn,)),), region)
        palm = (yaw - turn + math.pi) % (2 * math.pi) - math.pi
        models.append(
            Featureless(Scan(palm, feels, np.arange(800) // 80, ("yaw",), ("index",)), scene, 0.1, 0.05)
        )
    place = np.linspace(-math.pi, math.pi - 1e-9, 200)[:, None]
    palm = (place - 1.0 + math.pi) % (2 * math.pi) - math.pi
    for measured in (feels[3], np.full(8, 1.0)):
        np.testing.assert_allclose(
            models[1].log_likelihood(palm, measured), models[0].log_likelihood(place, measured), atol=0.01
        )


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
        model(scene=Scene("plain", SCENE.axes, SCENE.phalanges, region))
