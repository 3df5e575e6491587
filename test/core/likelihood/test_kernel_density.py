"""Kernel densities on the lattice agree with the sum over all pairs.

Down to 5 nats below the peak log-likelihoods differ by at most 0.05 nats, and the posterior of a cloud of
states by at most 0.5 % in total variation.
"""

from dataclasses import replace

import numpy as np
import pytest
from support import densities
from support.scans import density, scan, scene, strain_at, total_variation

from tactile_localizer.core.likelihood.kernel_density import KernelDensity
from tactile_localizer.errors import ParameterError
from tactile_localizer.scene import Axis, Phalanx, Scene
from tactile_localizer.sim import simulate_scan

PAPER = 0.0254 * np.sqrt(0.0075), np.full(16, np.sqrt(0.001))
TUNED = 0.0028, np.array([0.0195, 0.017, 0.026, 0.0119, 0.0169, 0.017, 0.0313, 0.0116] * 2)
"""As chosen from three scans of a grommet."""


def lattice(made, of, position_std, strain_std, **options):
    widths = np.full(of.dimension, position_std), np.broadcast_to(strain_std, of.layout.size)
    return KernelDensity(made.states, made.strain, *widths, of.wraps, of.layout, **options)


def cloud(kind, of, truth, count, rng, std):
    """States all over the scene, about the truth, or about some other place."""
    if kind == "spread":
        return of.lower + rng.random((count, of.dimension)) * of.extent
    centre = truth if kind == "converged" else of.lower + rng.random(of.dimension) * of.extent
    return np.clip(centre + std * rng.standard_normal((count, of.dimension)), of.lower, of.upper)


def compare(made, of, widths, truths, strains, kind, std, **options):
    rng, present = np.random.default_rng(0), np.ones(len(of.phalanges), bool)
    model = lattice(made, of, *widths, **options)
    for truth, strain in zip(truths, strains, strict=True):
        states = cloud(kind, of, truth, 75, rng, std)
        exact = densities.sum_of_gaussians(
            made.states, made.strain, *widths, states, strain, wraps=of.wraps, **options
        )
        found = model.log_density(states, strain, present)
        assert np.abs(found - exact)[exact > exact.max() - 5.0].max() <= 0.05
        assert total_variation(density(found), density(exact)) <= 5e-3


@pytest.mark.parametrize("kind", ["spread", "converged", "wrong"])
@pytest.mark.parametrize("feature", ["bump", "snap", "grommet"])
def test_it_agrees_with_the_sum_over_pairs_on_simulated_features(feature, kind):
    of = Scene("plane", (Axis("x", 0.0, 0.051), Axis("y", 0.0, 0.051)), scene(2).phalanges)
    made, test = simulate_scan(feature, 1, rate=50.0).to_scan(), simulate_scan(feature, 1, "test")
    rows = np.random.default_rng(1).integers(len(test), size=6)
    for widths in (PAPER, TUNED):
        compare(made, of, widths, test.truth[rows], test.strain[rows], kind, 0.0012)


@pytest.mark.parametrize("conditional", [True, False])
@pytest.mark.parametrize("kind", ["spread", "converged", "wrong"])
@pytest.mark.parametrize(("dimension", "full_turn"), [(1, False), (2, False), (3, False), (3, True)])
def test_it_agrees_with_the_sum_over_pairs_on_any_axes(dimension, full_turn, kind, conditional):
    of = scene(dimension, full_turn=full_turn)
    made = scan(np.random.default_rng(1), of, 3000)
    truths = of.lower + np.random.default_rng(2).random((6, dimension)) * of.extent
    widths = np.array([0.003, 0.003, 0.15])[:dimension], 0.06
    std = np.array([0.0015, 0.0015, 0.05])[:dimension]
    compare(made, of, widths, truths, strain_at(truths), kind, std, conditional=conditional)


def test_a_long_strip_is_evaluated_in_blocks():
    of = Scene("strip", (Axis("x", 0.0, 30.0),), (Phalanx("index", (0.0,)),))
    made = scan(np.random.default_rng(1), of, 3000)
    states, strain = made.states[:200], made.strain[5]
    exact = densities.sum_of_gaussians(made.states, made.strain, 0.001, 0.3, states, strain)
    found = lattice(made, of, 0.001, 0.3).log_density(states, strain, np.ones(1, bool))
    np.testing.assert_allclose(found, exact, atol=0.05)


def test_a_lattice_too_large_for_the_memory_is_refused_with_both_numbers():
    of = Scene("mm", (Axis("x", -3.0, 63.0), Axis("y", -3.0, 63.0)), (Phalanx("index", (0.0, 0.0)),))
    made = scan(np.random.default_rng(0), of, 100)
    with pytest.raises(ParameterError, match=r"at most 16,777,216 nodes for the 100 pairs .* got 3"):
        lattice(made, of, 0.0022, 0.03)


@pytest.mark.parametrize("absent", [0, 1, 2])
def test_an_absent_phalanx_drops_out(absent):
    of = scene(2, 3)
    made = scan(np.random.default_rng(1), of, 300)
    present = np.arange(3) != absent
    own = of.layout.expand(present)
    alone = Scene("alone", of.axes, tuple(p for p, here in zip(of.phalanges, present, strict=True) if here))
    states, strain = made.states[:50], made.strain[7].copy()
    strain[~own] = 1e9
    found = lattice(made, of, 0.003, 0.06).log_density(states, strain, present)
    own_only = lattice(
        replace(made, strain=made.strain[:, own], phalanges=alone.phalanx_names), alone, 0.003, 0.06
    )
    np.testing.assert_allclose(found, own_only.log_density(states, strain[own], np.ones(2, bool)), atol=1e-4)
