"""Densities of the sweep mixture, from given tables."""

import numpy as np
import pytest
from scipy import stats
from scipy.special import gammaln, logsumexp
from support.models import noise_model

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.likelihood.drift import Drift, Innovation
from tactile_localizer.core.likelihood.gain import Gain
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.on_map import OnMap, Places
from tactile_localizer.core.likelihood.other_material import OtherMaterial
from tactile_localizer.core.likelihood.scatter import Whitening
from tactile_localizer.core.likelihood.strain_map import StrainMap
from tactile_localizer.core.likelihood.student_t import DEGREES_OF_FREEDOM as NU
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture

NODES, COMPONENTS, GAIN = 30, 3, 0.2
STATES = (np.arange(NODES) + 0.5)[:, None] * 0.001


def mixture(counts: tuple[int, ...]) -> SweepMixture:
    """Random tables on a line with one node per mm, whitened by a factor of 4."""
    rng = np.random.default_rng(0)
    layout, size = ChannelLayout(counts), sum(counts)
    mean = 3.0 * rng.standard_normal((NODES, COMPONENTS, size))
    mean[:, 1:, 0] = mean[:, :1, 0] + rng.uniform(1.0, 3.0, (NODES, COMPONENTS - 1))
    variance = rng.uniform(1.0, 4.0, (NODES, COMPONENTS, len(counts)))
    prior = np.log(rng.dirichlet(np.ones(COMPONENTS), NODES))
    tables = (table.astype(np.float32) for table in (mean, variance, prior))
    lattice = np.array([0.0005]), np.array([0.001]), (NODES,)
    strain_map = StrainMap(*lattice, *tables, GAIN, np.zeros((1, size)))
    other = OtherMaterial(layout, np.eye(size), np.full(layout.phalanges, 1.3))
    drift = Drift(np.inf, 1.0, np.zeros(size))
    return SweepMixture(noise_model(layout, 4.0, 0.1), strain_map, drift, other, Material.SHEET)


def evaluated(
    model: SweepMixture,
    strain: np.ndarray,
    used: np.ndarray | None = None,
    level_variance: float = 0.0,
    gain: Gain | None = None,
) -> OnMap:
    """Likelihoods at the nodes of a strain, V, of a sweep without a level: each node is state and anchor."""
    layout = model.noise.layout
    nodes, expected = model.map_at(np.concatenate([STATES, STATES]))
    level = np.full(layout.size, level_variance)
    innovation = Innovation(model.whitened(strain), expected, level)
    used = np.ones(layout.phalanges, dtype=bool) if used is None else used
    gain = gain or Gain.start(layout.phalanges, len(nodes), model.gain_variance)
    return model.on_map(model.felt(innovation, used), Places(nodes, NODES, innovation.of_map, gain), 1.0)


def widened(model: SweepMixture, covariance: np.ndarray) -> SweepMixture:
    """The model of strains whose residuals have a covariance (W, W)."""
    return model.with_whitening(Whitening.of(model.noise.layout, covariance))


def log_constant(channels: int) -> float:
    """Constant of the t-density, omitted for all alternatives."""
    return float(gammaln((NU + channels) / 2) - gammaln(NU / 2) - channels / 2 * np.log(NU * np.pi))


def direct(
    model: SweepMixture,
    node: int,
    volts: np.ndarray,
    covariance: np.ndarray,
    components: int = COMPONENTS,
    gain: Gain | None = None,
) -> np.ndarray:
    """The log-densities (F,) at a node, by scipy and float64: visits differ in the gain of the signal.

    The ``covariance`` (C, C) is that of the strain's noise.
    """
    found, strain = [], model.whitened(volts)
    gain = gain or Gain.start(model.noise.layout.phalanges, NODES, GAIN)
    for phalanx, own in enumerate(model.noise.layout.slices):
        terms, size, factor = [], own.stop - own.start, float(gain.mean[phalanx, node])
        for component in range(components):
            mean = model.map.mean[node, component, own].astype(np.float64)
            shape = float(model.map.variance[node, component, phalanx]) * covariance[own, own]
            shape += float(gain.variance[phalanx, node]) * np.outer(mean, mean)
            density = stats.multivariate_t(factor * mean, shape, df=NU).logpdf(strain[own])
            prior = model.map.log_prior[node, component] if components > 1 else 0.0
            terms.append(float(prior) + density)
        found.append(float(logsumexp(terms)) - log_constant(size))
    return np.array(found)


@pytest.mark.parametrize("counts", [(1,), (3, 5), (8, 8)])
def test_float32_tables_agree_with_direct_evaluation(counts: tuple[int, ...]) -> None:
    """Whatever is known of the gain along each trajectory."""
    model, rng = mixture(counts), np.random.default_rng(1)
    for volts in (1.0, 10.0, 1e3):
        strain, shape = volts * rng.standard_normal(sum(counts)), (len(counts), NODES)
        known = (rng.uniform(0.5, 2.0, shape), rng.uniform(0.01, 0.3, shape))
        gain = Gain(np.stack(known).astype(np.float32))
        found = evaluated(model, strain, gain=Gain(np.tile(gain.moments, 2)))
        one = np.eye(len(strain))
        for values, components in ((found.states, COMPONENTS), (found.anchors, 1)):
            expected = [direct(model, node, strain, one, components, gain).sum() for node in range(NODES)]
            np.testing.assert_allclose(values, expected, atol=2e-3)


def test_strains_of_a_covariance_have_the_densities_of_the_whole_of_it() -> None:
    """It adds to what the gain explains, and may be added twice."""
    model, rng = mixture((3, 5)), np.random.default_rng(2)
    strain, covariance = rng.standard_normal(8), np.eye(8)
    for own in model.noise.layout.slices:
        factor = rng.standard_normal((own.stop - own.start,) * 2)
        covariance[own, own] += factor @ factor.T
    twice = widened(widened(model, 2.0 * np.eye(8)), 0.5 * covariance)
    for other in (widened(model, covariance), twice):
        found = evaluated(other, strain).states + other.log_volume.sum()
        plain = model.log_volume.sum()
        expected = [direct(model, node, strain, covariance).sum() + plain for node in range(NODES)]
        np.testing.assert_allclose(found, expected, atol=2e-3)


def test_residuals_of_one_model_are_taken_to_the_units_of_another() -> None:
    model, rng = mixture((3, 5)), np.random.default_rng(3)
    factors = rng.standard_normal((2, 8, 8))
    one, other = (model.with_noise(0.1 * each @ each.T) for each in factors)
    strain = rng.standard_normal(8)
    innovation = Innovation(strain, np.zeros((0, 8)), np.zeros(8))
    before, after = (each.felt(innovation, np.ones(2, dtype=bool)).strain for each in (one, other))
    np.testing.assert_allclose(other.whitening_after(one) @ before, after, rtol=1e-4, atol=1e-5)


def test_other_material_of_a_covariance_is_whitened_as_the_strain_is() -> None:
    model, strain = mixture((3, 5)), np.linspace(-2.0, 2.0, 8)
    covariance = np.diag(np.linspace(1.0, 50.0, 8))
    noisy, level, used = widened(model, covariance), np.zeros(2), np.ones(2, dtype=bool)
    felt, _ = noisy.off_map(Innovation(strain, np.zeros((0, 8)), np.zeros(8)))
    whitening = np.diag(covariance.diagonal() ** -0.5)
    np.testing.assert_allclose(felt, whitening @ strain, rtol=1e-6)
    expected = model.other.transformed(whitening).update(model.other.start(), felt, level, used, 0.0, 1.0)
    found = noisy.other.update(noisy.other.start(), felt, level, used, 0.0, 1.0)
    assert found[0] == pytest.approx(expected[0])


def test_moments_are_of_the_residuals_that_the_scan_expects_at_the_gain_of_the_sweep() -> None:
    """In variances of a visit with the level's, of the t-distribution; an outlier has the largest of them."""
    model, strain = mixture((3, 5)), np.array([1.0, -2.0, 0.5, 1.5, 0.0, 2.0, -1.0, 1.0])
    layout, weights, used = model.noise.layout, np.zeros(NODES), np.ones(2, dtype=bool)
    nodes, mean = model.map_at(STATES)
    weights[[4, 7]] = 0.75, 0.25
    gain = Gain(np.stack([np.full((2, NODES), each, dtype=np.float32) for each in (0.5, 0.1)]))
    for volts, bounded in ((strain, False), (1e4 * strain, True)):
        innovation = Innovation(model.whitened(volts), mean, np.full(8, 3.0))
        there = Places(nodes, NODES, mean, gain)
        found = model.moments(model.felt(innovation, used), there, weights)
        width = np.sqrt(layout.expand(model.map.variance[nodes, 0] + 3.0))
        residual = (model.whitened(volts) - 0.5 * mean) / width
        if bounded:
            residual *= layout.expand(np.sqrt(100.0 / layout.mean(residual**2)))
        blocks = np.equal.outer(layout.phalanx, layout.phalanx)
        expected = 0.75 * np.einsum("p,pi,pj->ij", weights, residual, residual) * blocks
        np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-5)
    wide = widened(model, 4.0 * np.eye(8))
    doubled = wide.moments(wide.felt(innovation, used), there, weights)
    np.testing.assert_allclose(doubled, found, rtol=1e-3)  # outliers are bounded alike


def test_strains_of_another_force_teach_the_gain_that_of_the_sweep() -> None:
    """At the node where they are felt: its signal, times a half."""
    model = mixture((8,))
    signal = np.linalg.solve(model.noise.whitening, model.map.mean[4, 0].astype(np.float64))
    gain = Gain.start(1, 2 * NODES, model.gain_variance)
    for _ in range(100):
        found = evaluated(model, model.noise.centre + 0.5 * signal, gain=gain)
        gain = found.gain
    assert gain.mean[0, NODES + 4] == pytest.approx(0.5, abs=0.02)
    assert found.anchors.argmax() == 4


def test_components_that_are_alike_are_one() -> None:
    """Two of three that differ by a tenth of a noise width; the mixture is nearly the same."""
    model, strain = mixture((3, 5)), np.array([1.0, -2.0, 0.5, 1.5, 0.0, 2.0, -1.0, 1.0])
    tables = model.map._replace(mean=model.map.mean.copy(), variance=model.map.variance.copy())
    tables.mean[:, 1] = tables.mean[:, 0] + np.float32(0.03)
    tables.variance[:, 1] = tables.variance[:, 0]
    merged = SweepMixture(model.noise, tables, model.drift, model.other, Material.SHEET)
    found = evaluated(merged, strain).states
    expected = [direct(merged, node, strain, np.eye(8)) for node in range(NODES)]
    np.testing.assert_allclose(found, np.sum(expected, axis=1), atol=0.1)


def test_a_signal_of_another_force_fits_better_than_as_large_a_deviation_in_its_shape() -> None:
    model = mixture((8,))
    signal = np.linalg.solve(model.noise.whitening, model.map.mean[4, 0].astype(np.float64))
    turned = np.roll(signal, 1) * np.linalg.norm(signal) / np.linalg.norm(np.roll(signal, 1))
    stronger, other = (
        evaluated(model, model.noise.centre + signal + 0.5 * more).anchors[4] for more in (signal, turned)
    )
    assert stronger > other + 1.0


def test_the_mixture_drops_an_absent_phalanx() -> None:
    model, used = mixture((3, 5)), np.array([False, True])
    strain = np.random.default_rng(3).standard_normal(8)
    one = evaluated(model, strain, used)
    strain[:3] = 1e6
    for before, after in zip(one[:2], evaluated(model, strain, used), strict=False):
        np.testing.assert_array_equal(before, after)


def test_a_noisy_channel_loses_its_weight_and_the_others_keep_theirs() -> None:
    """Of one phalanx of two channels, one of which is noise alone in this sweep."""
    model, volts = mixture((2,)), np.array([3.0, -2.0])
    noisy = model.with_noise(np.diag([1e12, 0.0]))
    found, burst = (evaluated(noisy, volts + np.array([by, 0.0])).anchors for by in (0.0, 1e3))
    np.testing.assert_allclose(burst, found, atol=1e-3)
    residual = model.whitened(volts)[1] - model.map.mean[:, 0, 1]
    variance = model.map.variance[:, 0, 0]
    total = variance + GAIN * model.map.mean[:, 0, 1] ** 2
    left = residual**2 * variance / total
    alone = -0.5 * ((NU + 2.0) * np.log(variance + left / NU) - (NU + 1.0) * np.log(variance) + np.log(total))
    np.testing.assert_allclose(found, alone, atol=2e-3)
    np.testing.assert_array_equal(evaluated(model, volts).states, evaluated(mixture((2,)), volts).states)


def test_uncertainty_of_the_level_widens_every_density() -> None:
    model, far = mixture((3, 5)), np.full(8, 300.0)
    sure, unsure = (evaluated(model, far, level_variance=variance) for variance in (0.0, 100.0))
    assert (unsure.states > sure.states).all()
    assert (unsure.anchors > sure.anchors).all()


@pytest.mark.parametrize("strain", [1e6, -1e6, 1e12])
def test_outliers_have_a_finite_mixture_density(strain: float) -> None:
    found = evaluated(mixture((3, 5)), np.full(8, strain)).states
    assert np.isfinite(found).all()
    assert np.ptp(found) < 2 * 0.5 * NU * np.log(4.0), "the variance alone tells places apart"


def test_a_whitened_strain_is_that_of_its_volts() -> None:
    model, (felt, volts) = mixture((3, 5)), np.random.default_rng(0).standard_normal((2, 8))
    np.testing.assert_allclose(model.in_volts(felt, model.whitened(volts)), volts)
