"""The sum-of-Gaussians model agrees with the sum over all pairs (the paper's Eq. 4), conditional and joint.

Down to 5 nats below the peak log-likelihoods differ by at most 0.05 nats, and the posterior of a cloud of
states by at most 0.5 % in total variation.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import softmax
from support import densities
from support.scans import scan, scene, strain_at

from tactile_localizer.paper.sum_of_gaussians import SumOfGaussians
from tactile_localizer.scene import Axis, Phalanx, Scene
from tactile_localizer.sim import simulate_recording, simulate_scan

PAPER = 0.0254 * np.sqrt(0.0075), np.full(16, np.sqrt(0.001))
TUNED = 0.0028, np.array([0.0195, 0.017, 0.026, 0.0119, 0.0169, 0.017, 0.0313, 0.0116] * 2)
"""As chosen from three scans of a grommet."""


def cloud(kind, of, truth, count, rng, std):
    """States all over the scene, about the truth, or about some other place."""
    if kind == "spread":
        return of.lower + rng.random((count, of.dimension)) * of.extent
    centre = truth if kind == "converged" else of.lower + rng.random(of.dimension) * of.extent
    return np.clip(centre + std * rng.standard_normal((count, of.dimension)), of.lower, of.upper)


def compare(made, of, widths, truths, strains, std, **options):
    """Of a scan whose yaw is two turns further on, at states of one turn further on."""
    turn = 2 * np.pi * of.wraps
    model = SumOfGaussians(replace(made, states=made.states + 2 * turn), of, *widths, **options)
    for kind in ("spread", "converged", "wrong"):
        rng = np.random.default_rng(0)
        for truth, strain in zip(truths, strains, strict=True):
            states = cloud(kind, of, truth, 75, rng, std)
            exact = densities.sum_of_gaussians(
                made.states, made.strain, *widths, states, strain, wraps=of.wraps, **options
            )
            found = model.log_likelihood(states + turn, strain)
            assert np.abs(found - exact)[exact > exact.max() - 5.0].max() <= 0.05, kind
            assert 0.5 * np.abs(softmax(found) - softmax(exact)).sum() <= 5e-3, kind


@pytest.mark.parametrize("feature", ["bump", "snap", "grommet"])
def test_it_agrees_with_the_sum_over_pairs_on_simulated_features(feature):
    of = Scene("plane", (Axis("x", 0.0, 0.051), Axis("y", 0.0, 0.051)), scene(2).phalanges)
    made = simulate_scan(feature, 1, rate=50.0)
    test = simulate_recording(feature, 1, "test").sweeps
    truth, strain = (np.concatenate([getattr(each, name) for each in test]) for name in ("truth", "strain"))
    rows = np.random.default_rng(1).integers(len(truth), size=6)
    for widths in (PAPER, TUNED):
        compare(made, of, widths, truth[rows], strain[rows], 0.0012)


@pytest.mark.parametrize("conditional", [True, False])
@pytest.mark.parametrize(("dimension", "full_turn"), [(1, False), (2, False), (3, False), (3, True)])
def test_it_agrees_with_the_sum_over_pairs_on_any_axes(dimension, full_turn, conditional):
    of = scene(dimension, full_turn=full_turn)
    made = scan(np.random.default_rng(1), of, 3000)
    truths = of.lower + np.random.default_rng(2).random((6, dimension)) * of.extent
    widths = np.array([0.003, 0.003, 0.15])[:dimension], 0.06
    std = np.array([0.0015, 0.0015, 0.05])[:dimension]
    compare(made, of, widths, truths, strain_at(truths), std, conditional=conditional)


def test_it_agrees_on_a_strip_of_many_kernel_widths():
    of = Scene("strip", (Axis("x", 0.0, 30.0),), (Phalanx("index", (0.0,)),))
    made = scan(np.random.default_rng(1), of, 3000)
    states, strain = made.states[:200], made.strain[5]
    exact = densities.sum_of_gaussians(made.states, made.strain, 0.001, 0.3, states, strain)
    found = SumOfGaussians(made, of, 0.001, 0.3).log_likelihood(states, strain)
    np.testing.assert_allclose(found, exact, atol=0.05)


@pytest.mark.parametrize("width", [2 * np.pi, 1e12])
def test_on_a_full_turn_a_kernel_as_wide_as_the_turn_is_uniform(width):
    of = scene(3, full_turn=True)
    made = scan(np.random.default_rng(1), of, 300)
    states = np.column_stack([np.full((9, 2), 0.02), np.linspace(-np.pi, np.pi, 9)])
    found = SumOfGaussians(made, of, np.array([0.003, 0.003, width]), 0.06).log_likelihood(
        states, made.strain[5]
    )
    assert np.isfinite(found).all()
    assert np.ptp(found) < 1e-6


@pytest.mark.parametrize("absent", [0, 1, 2])
def test_an_absent_phalanx_drops_out(absent):
    of = scene(2, 3)
    made = scan(np.random.default_rng(1), of, 300)
    others = replace(of, phalanges=of.phalanges[:absent] + of.phalanges[absent + 1 :])
    present = np.arange(3) != absent
    own = of.layout.expand(present)
    states, strain = made.states[:50], np.where(own, made.strain[7], 1e9)
    found = SumOfGaussians(made, of, 0.003, 0.06).log_likelihood(states, strain, present)
    expected = SumOfGaussians(made, others, 0.003, 0.06).log_likelihood(states, strain[own])
    np.testing.assert_allclose(found, expected, atol=1e-4)
