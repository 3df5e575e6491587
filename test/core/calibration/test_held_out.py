"""Tempering and registration error, from sweeps that are localized on the map of the others."""

from dataclasses import replace

import numpy as np
import pytest
from support.scans import slides

from tactile_localizer.core.calibration.held_out import (
    independent_samples,
    surroundings,
)
from tactile_localizer.core.factory import learn
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Axis, Phalanx, Scene

LENGTH = 0.1
SCENE = Scene("cloth", (Axis("x", 0.0, LENGTH),), (Phalanx("index", (0.0,)),))


def cloth(shift: float, repeats: int = 6, seed: int = 0) -> Scan:
    """Slides over waves of 10 to 40 mm, whose positions are off by ``shift`` m to either side."""
    rng = np.random.default_rng(seed)
    x = np.arange(0.0, LENGTH, 0.0005)
    waves, phase = np.linspace(150.0, 600.0, 8), np.arange(8.0)
    off = shift * (1.0 - 2.0 * (np.arange(repeats) % 2))
    strain = [
        10.0 * np.sin((x[:, None] + each) * waves + phase) + rng.standard_normal((len(x), 8)) for each in off
    ]
    return slides(SCENE, x, strain)


def test_shifted_sweeps_give_the_registration_error() -> None:
    registration = {shift: float(learn(cloth(shift), SCENE).registration_std[0]) for shift in (0.0, 0.001)}
    assert registration[0.0] < 0.0005
    assert registration[0.001] == pytest.approx(0.001, rel=0.4)


def test_a_featureless_approach_does_not_affect_the_registration_error() -> None:
    scan = cloth(0.002)
    x, rng = scan.states[:, 0], np.random.default_rng(1)
    featureless = np.abs(x - 0.085) > 0.015
    strain = np.where(featureless[:, None], rng.standard_normal(scan.strain.shape), scan.strain)
    calibration = learn(replace(scan, strain=strain), SCENE)
    assert calibration.registration_std[0] > 0.0008


def test_correlated_errors_count_once_per_correlation_length() -> None:
    rng = np.random.default_rng(0)
    free = rng.standard_normal(400)
    assert independent_samples(np.full(400, 0.001)) == pytest.approx(1.0, rel=0.01)
    assert independent_samples(free) == pytest.approx(400.0, rel=0.35)
    assert independent_samples(np.repeat(free[:100], 4)) == pytest.approx(100.0, rel=0.35)


def test_a_sweep_is_localized_in_its_surroundings() -> None:
    axes = (Axis("x", -1.0, 1.0), Axis("y", 0.0, 0.1), Axis("yaw", -np.pi, np.pi))
    scene = Scene("large", axes, (Phalanx("index", (0.0, 0.0, 0.0)),))
    near = surroundings(scene, np.array([[0.3, 0.02, 0.0], [0.4, 0.03, 0.0]]))
    np.testing.assert_allclose(near.lower, [0.25, 0.0, -np.pi])
    np.testing.assert_allclose(near.upper, [0.45, 0.08, np.pi])


def test_a_single_sweep_gets_the_prior_of_the_registration_error() -> None:
    assert learn(cloth(0.0, 1), SCENE).registration_std[0] == pytest.approx(0.0005)


def test_two_long_slides_outweigh_the_prior() -> None:
    assert learn(cloth(0.0, 2), SCENE).registration_std[0] < 0.0007
