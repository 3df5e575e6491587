"""Extremes at which the paper's models must be right (docs/numerics.md)."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import trapezoid
from support.scans import SIDE, scan, scene, strain_at

from tactile_localizer.errors import ParameterError, SceneError
from tactile_localizer.paper.featureless import Featureless
from tactile_localizer.paper.gaussian import Gaussian, IndependentGaussian
from tactile_localizer.paper.sum_of_gaussians import SumOfGaussians
from tactile_localizer.scene import Axis, Phalanx, Region, Scene

FEATURE = Region((0.015, -math.inf), (0.035, math.inf))
OF = scene(2, 2, FEATURE)
SCAN = scan(np.random.default_rng(0), OF, 800)
TRUTH = np.array([0.021, 0.027])
STATES = np.random.default_rng(1).random((200, 2)) * SIDE
SMALLEST, LARGEST = 1e-6, 1e6
"""Kernel widths whose squares are 1e-12 and 1e12."""


def build(model, made=SCAN, of=OF, position_std=0.003, strain_std=0.06, neighbours=8):
    if model == "sum_of_gaussians":
        return SumOfGaussians(made, of, position_std, strain_std)
    if model == "featureless":
        return Featureless(made, of, position_std, strain_std)
    return (Gaussian if model == "gaussian" else IndependentGaussian)(made, of, neighbours)


KERNELS, GAUSSIANS = ["sum_of_gaussians", "featureless"], ["gaussian", "gaussian_independent"]
every_model = pytest.mark.parametrize("model", KERNELS + GAUSSIANS)
kernel_models = pytest.mark.parametrize("model", KERNELS)


@every_model
@pytest.mark.parametrize("size", [1e-9, 0.06e6, 1e9, 1e99])
def test_the_background_explains_strains_of_any_size_at_every_state(model, size):
    built = build(model)
    for direction in (1.0, -1.0, np.random.default_rng(0).standard_normal(16)):
        values = built.log_likelihood(STATES, strain_at(TRUTH[None])[0] + size * direction)
        assert np.isfinite(values).all()
        if size > 1:  # where less was scanned the background counts more; nothing else tells states apart
            assert np.ptp(values) < 6.0
            assert values.max() < -100


def test_a_strain_that_one_place_alone_explains_is_finite_everywhere():
    """Kernels so narrow that the density there is beyond a double's range of that of the background."""
    of = scene(2, 5)
    made = scan(np.random.default_rng(0), of, 800)
    model, place = build("sum_of_gaussians", made, of, strain_std=1e-12), made.states[3]
    values = model.log_likelihood(np.concatenate([STATES, place[None]]), made.strain[3])
    assert np.isfinite(values).all()
    peak = -40.0 * (math.log(1e-12) + 0.5 * math.log(2.0 * math.pi))  # of the kernel in strain
    assert values[-1] == pytest.approx(peak, abs=5.0)  # less the share of the pair among those around it


@kernel_models
def test_position_kernels_of_any_width_give_finite_densities_or_are_refused(model):
    values = build(model, position_std=LARGEST).log_likelihood(STATES, SCAN.strain[3])
    assert np.isfinite(values).all()
    if model == "sum_of_gaussians":
        assert np.ptp(values) < 1e-3  # every state sees the whole scan
    with pytest.raises(ParameterError, match=r"at most 8,388,608 nodes for the 800 pairs .* got \d"):
        build(model, position_std=SMALLEST)
    one = SCAN.select(np.array([3]))
    if model == "sum_of_gaussians":
        values = build(model, one, position_std=SMALLEST).log_likelihood(
            np.concatenate([STATES, one.states]), one.strain[0]
        )
        assert np.isfinite(values).all()
        assert np.argmax(values) == len(STATES)  # every other state sees the background


@kernel_models
@pytest.mark.parametrize("strain_std", [1e-12, SMALLEST, LARGEST, 1e12])
def test_strain_kernels_of_any_width_give_finite_densities(model, strain_std):
    built = build(model, strain_std=strain_std)
    states = np.concatenate([STATES, SCAN.states[3:4]])
    for measured in (SCAN.strain[3], SCAN.strain[3] + 0.1):
        values = built.log_likelihood(states, measured)
        assert np.isfinite(values).all()
    if model == "sum_of_gaussians":
        values = built.log_likelihood(states, SCAN.strain[3])
        if strain_std < 1:
            assert np.argmax(values) == 200  # only the pair itself is near its own strain
        else:
            assert np.ptp(values) < 0.1  # every strain is as good as any other


@every_model
def test_a_scan_of_one_pair(model):
    one = SCAN.select(np.array([100]))
    if model == "featureless":
        with pytest.raises(SceneError, match="expected pairs of phalanx index on both sides"):
            build(model, one)
        return
    built = build(model, one)
    values = built.log_likelihood(np.concatenate([one.states, STATES]), one.strain[0])
    assert np.isfinite(values).all()
    assert values[0] == pytest.approx(values.max(), abs=0.02)


@every_model
def test_duplicate_pairs_give_the_same_density(model):
    """Every pair ten times over is the same density: the scan's own density is divided out."""
    rows = np.repeat(np.arange(len(SCAN)), 10)
    once, tenfold = build(model, neighbours=8), build(model, SCAN.select(rows), neighbours=80)
    a, b = (one.log_likelihood(STATES, SCAN.strain[3]) for one in (once, tenfold))
    assert np.isfinite(b).all()
    if model in ("sum_of_gaussians", "featureless"):
        np.testing.assert_allclose(b, a, atol=0.02)


@every_model
def test_the_density_integrates_to_one_over_the_strain(model):
    """Of a phalanx with one channel, on the feature and off it, among the pairs and a metre away."""
    line = Scene("line", (Axis("x", 0.0, SIDE),), (Phalanx("a", (0.0,), 1),), Region((0.02,), (1.0,)))
    built = build(model, scan(np.random.default_rng(0), line, 150), line)
    places = np.array([[0.01], [0.03], [-1.0], [1.0]])
    volts = np.linspace(-10.0, 10.0, 2_001)
    densities = [np.exp(built.log_likelihood(places, np.array([one]))) for one in volts]
    np.testing.assert_allclose(trapezoid(densities, volts, axis=0), 1.0, atol=5e-3)


@every_model
@pytest.mark.parametrize("volts", [1e-9, 1e9])
def test_strains_of_a_nanovolt_and_a_gigavolt_are_only_another_unit(model, volts):
    """Scan, widths and measurement in other units: the density changes by the Jacobian alone."""
    scaled = replace(SCAN, strain=SCAN.strain * volts)
    plain = build(model).log_likelihood(STATES, SCAN.strain[3])
    other = build(model, scaled, strain_std=0.06 * volts).log_likelihood(STATES, SCAN.strain[3] * volts)
    np.testing.assert_allclose(other + 16 * math.log(volts), plain, atol=0.02)
