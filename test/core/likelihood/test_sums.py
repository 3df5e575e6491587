"""Kernel sums: truncated and field evaluation agree with the exact one."""

import math

import numpy as np
import pytest
from support.scans import scan, scene, strain_at

from tactile_localizer.channels import DEFAULT_CHANNELS, ChannelLayout
from tactile_localizer.core.likelihood.kernels.pair_block import HEADROOM
from tactile_localizer.core.likelihood.kernels.sums import KernelSum
from tactile_localizer.errors import ParameterError

WIDTHS = np.array([0.003, 0.003, 0.15])
BOTH = np.ones(2, bool)
ONE = ChannelLayout((DEFAULT_CHANNELS,))


def kernel_sum(evaluation, dimension=2, pairs=400, full_turn=False, widths=WIDTHS, **options):
    of = scene(dimension, full_turn=full_turn)
    made = scan(np.random.default_rng(1), of, pairs)
    return KernelSum(
        made.states,
        made.strain,
        widths[:dimension],
        np.full(2 * DEFAULT_CHANNELS, 0.05),
        of.wraps,
        of.layout,
        evaluation,
        **options,
    )


def written_out(states, positions, strain, measured, widths, strain_std=0.05):
    """Both sums as in the paper, pair by pair, including the scale."""
    sums, density = np.zeros(len(states)), np.zeros(len(states))
    constant = -DEFAULT_CHANNELS * math.log(2 * math.pi) - 2 * DEFAULT_CHANNELS * math.log(strain_std)
    for place, felt in zip(positions, strain, strict=True):
        near = np.exp(-0.5 * np.sum(((states - place) / widths) ** 2, axis=1))
        density += near
        sums += near * math.exp(constant - 0.5 * np.sum(((measured - felt) / strain_std) ** 2))
    return sums, density


def test_exact_evaluation():
    of = scene()
    made = scan(np.random.default_rng(1), of)
    rng = np.random.default_rng(2)
    states = of.lower + rng.random((20, 2)) * 0.05
    measured = strain_at(states[:1])[0]
    sums, density, log_scale = kernel_sum("exact").at_states(states, measured, BOTH)
    expected, expected_density = written_out(states, made.states, made.strain, measured, WIDTHS[:2])
    np.testing.assert_allclose(np.log(sums) + log_scale, np.log(expected), atol=1e-8)
    np.testing.assert_allclose(density, expected_density, rtol=1e-9)


@pytest.mark.parametrize("evaluation", ["truncated", "field"])
@pytest.mark.parametrize("dimension", [1, 2, 3])
@pytest.mark.parametrize("spread", [0.02, 0.1, 1.0])
def test_evaluations_agree_near_their_peak(evaluation, dimension, spread):
    of, exact, other = scene(dimension), kernel_sum("exact", dimension), kernel_sum(evaluation, dimension)
    rng = np.random.default_rng(3)
    for _ in range(10):
        truth = of.lower + rng.random(dimension) * (of.upper - of.lower)
        states = np.clip(
            truth + spread * (rng.random((75, dimension)) - 0.5) * (of.upper - of.lower), of.lower, of.upper
        )
        measured = strain_at(truth[None])[0]
        sums, density, log_scale = exact.at_states(states, measured, BOTH)
        found, found_density, found_scale = other.at_states(states, measured, BOTH)
        near = sums > sums.max() * math.exp(-5)
        difference = np.log(found[near]) + found_scale - np.log(sums[near]) - log_scale
        assert np.abs(difference).max() < 0.02
        np.testing.assert_allclose(found_density, density, rtol=5e-3, atol=2e-3 * density.max())


@pytest.mark.parametrize("evaluation", ["exact", "truncated", "field"])
@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_sums_on_axes_agree_with_sums_at_states(evaluation, dimension):
    of, sums = scene(dimension), kernel_sum(evaluation, dimension)
    axes = [
        np.linspace(low, high, 7 + axis)
        for axis, (low, high) in enumerate(zip(of.lower, of.upper, strict=True))
    ]
    states = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    measured = strain_at(states.reshape(-1, dimension)[:1])[0]
    on_axes, density, scale = sums.on_axes(axes, measured, BOTH)
    at_states, density_at, scale_at = sums.at_states(states.reshape(-1, dimension), measured, BOTH)
    assert on_axes.shape == density.shape == states.shape[:-1]
    assert scale == pytest.approx(scale_at, abs=1e-9)
    np.testing.assert_allclose(on_axes.ravel(), at_states, rtol=1e-3, atol=1e-6 * at_states.max())
    np.testing.assert_allclose(density.ravel(), density_at, rtol=1e-3, atol=1e-3 * density_at.max())


@pytest.mark.parametrize("evaluation", ["exact", "truncated", "field"])
def test_both_ends_of_a_full_turn_are_the_same_place(evaluation):
    of, sums = scene(3, full_turn=True), kernel_sum(evaluation, 3, full_turn=True)
    states = np.array([[0.02, 0.03, -math.pi], [0.02, 0.03, math.pi]])
    measured = strain_at(states[:1])[0]
    found, density, _ = sums.at_states(states, measured, BOTH)
    assert found[0] == pytest.approx(found[1], rel=1e-2)
    assert density[0] == pytest.approx(density[1], rel=1e-2)
    assert density[0] == pytest.approx(
        sum(
            np.exp(
                -0.5 * np.sum(((scan(np.random.default_rng(1), of).states - state) / WIDTHS) ** 2, axis=1)
            ).sum()
            for state in states
        ),
        rel=1e-2,
    )


def test_kernel_sums_wrap_pairs_beyond_a_turn():
    """The yaw of a phalanx that is turned against the palm exceeds pi."""
    rng = np.random.default_rng(0)
    positions = rng.random((300, 1)) * 2 * math.pi - math.pi
    strain = rng.standard_normal((300, DEFAULT_CHANNELS))
    plain, turned = (
        KernelSum(
            positions + shift, strain, np.array([0.3]), np.ones(DEFAULT_CHANNELS), np.array([True]), ONE
        )
        for shift in (0.0, 2.5)
    )
    states = np.linspace(-math.pi, math.pi, 50)[:, None]
    _, density, _ = plain.at_states(states, strain[0], BOTH[:1])
    moved = (states + 2.5 + math.pi) % (2 * math.pi) - math.pi
    np.testing.assert_allclose(turned.at_states(moved, strain[0], BOTH[:1])[1], density, rtol=1e-3)


def test_a_kernel_too_narrow_for_a_grid_is_summed_directly():
    narrow = np.full(3, 1e-6)
    rng = np.random.default_rng(0)
    states = rng.random((75, 2)) * 0.05
    sums = kernel_sum("field", widths=narrow)
    made = scan(np.random.default_rng(1), scene(), 400)
    found, density, _ = sums.at_states(np.concatenate([states, made.states[:3]]), made.strain[0], BOTH)
    np.testing.assert_allclose(density[-3:], 1.0)
    assert math.log(found[75]) == pytest.approx(HEADROOM)
    axes = [np.sort(made.states[:4, 0]), np.sort(made.states[:5, 1])]
    assert np.isfinite(sums.on_axes(axes, made.strain[0], BOTH)[0]).all()


def test_sums_are_zero_far_from_every_pair():
    for evaluation in ("exact", "truncated", "field"):
        sums, density, _ = kernel_sum(evaluation).at_states(np.full((4, 2), 50.0), np.zeros(16), BOTH)
        assert (sums == 0).all()
        assert (density == 0).all()


def test_the_block_of_pairs_follows_the_belief():
    """Sums with the reused block of pairs agree with those of a new one."""
    following = kernel_sum("field", pairs=4000)
    rng = np.random.default_rng(0)
    for x in np.linspace(0.0, 0.05, 30):
        states = np.array([x, 0.02]) + 0.0005 * rng.standard_normal((75, 2))
        measured = strain_at(states[:1])[0]
        found = following.at_states(states, measured, BOTH)
        anew = kernel_sum("exact", pairs=4000).at_states(states, measured, BOTH)
        np.testing.assert_allclose(np.log(found[0]) + found[2], np.log(anew[0]) + anew[2], atol=0.01)


def test_an_unknown_evaluation_is_refused():
    with pytest.raises(ParameterError, match="evaluation 'fast': expected one of field, truncated, exact"):
        kernel_sum("fast")
