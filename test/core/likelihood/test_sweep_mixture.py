"""Densities of the sweep mixture, from given tables."""

import numpy as np
import pytest
from scipy import stats
from scipy.special import gammaln, logsumexp

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.likelihood.drift import Drift, Innovation
from tactile_localizer.core.likelihood.evaluation import INFLATION, Likelihoods
from tactile_localizer.core.likelihood.noise_model import NoiseModel
from tactile_localizer.core.likelihood.strain_map import StrainMap
from tactile_localizer.core.likelihood.student_t import DEGREES_OF_FREEDOM as NU
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture

NODES, COMPONENTS = 30, 3
STATES = (np.arange(NODES) + 0.5)[:, None] * 0.001


def mixture(
    counts: tuple[int, ...], featureless: float | None = 1.3, seed: int = 0, nodes: int = NODES
) -> SweepMixture:
    """Random tables on a line with one node per mm, whitened by a factor of 4."""
    rng = np.random.default_rng(seed)
    layout, size = ChannelLayout(counts), sum(counts)
    mean = 3.0 * rng.standard_normal((nodes, COMPONENTS, size))
    variance = rng.uniform(1.0, 4.0, (nodes, COMPONENTS, len(counts)))
    prior = np.log(rng.dirichlet(np.ones(COMPONENTS), nodes))
    tables = (table.astype(np.float32) for table in (mean, variance, prior))
    strain_map = StrainMap(
        np.array([0.0005]), np.array([0.001]), (nodes,), *tables, featureless, *np.zeros((2, 1, size))
    )
    volume = np.array(counts) * np.log(0.25)
    noise = NoiseModel(layout, np.full(size, 0.1), 0.25 * np.eye(size), volume, *np.zeros((2, size)))
    drift = Drift(np.inf, 1.0, np.zeros(size))
    return SweepMixture(noise, strain_map, drift, 0.002)


def evaluated(
    model: SweepMixture,
    strain: np.ndarray,
    used: np.ndarray | None = None,
    states: np.ndarray = STATES,
    level_variance: float = 0.0,
) -> Likelihoods:
    """Likelihoods of a strain, V, of a sweep without an offset; the nodes of the map are the references."""
    layout = model.noise.layout
    places = np.concatenate([states, STATES[: len(model.map.mean)]])
    nodes, expected = model.expected(places)
    level = np.full(layout.size, level_variance)
    innovation = Innovation(model.whitened(strain), expected, np.zeros_like(expected), level)
    weights = np.full(len(states), -np.log(len(states)))
    return model.evaluate(
        nodes, weights, innovation, np.ones(layout.phalanges, bool) if used is None else used
    )


def log_constant(channels: int) -> float:
    """Constant of the t-density, omitted for all alternatives."""
    return float(gammaln((NU + channels) / 2) - gammaln(NU / 2) - channels / 2 * np.log(NU * np.pi))


def direct(
    model: SweepMixture, node: int, volts: np.ndarray, inflation: float = 1.0, components: int = COMPONENTS
) -> float:
    """The density at a node, by scipy and float64."""
    total, strain = 0.0, model.whitened(volts)
    for phalanx, own in enumerate(model.noise.layout.slices):
        terms, size = [], own.stop - own.start
        for component in range(components):
            shape = inflation * float(model.map.variance[node, component, phalanx])
            mean = model.map.mean[node, component, own].astype(np.float64)
            density = stats.multivariate_t(mean, shape * np.eye(size), df=NU).logpdf(strain[own])
            prior = model.map.log_prior[node, component] if components > 1 else 0.0
            terms.append(float(prior) + density)
        total += float(logsumexp(terms)) + float(model.noise.log_volume[phalanx]) - log_constant(size)
    return total


@pytest.mark.parametrize("counts", [(1,), (3, 5), (8, 8)])
def test_float32_tables_agree_with_direct_evaluation(counts: tuple[int, ...]) -> None:
    model, rng = mixture(counts), np.random.default_rng(1)
    for scale in (1.0, 10.0, 1e3):
        strain = scale * rng.standard_normal(sum(counts))
        found = evaluated(model, strain)
        expected = [direct(model, node, strain) for node in range(NODES)]
        first, wide = (
            np.array([direct(model, node, strain, inflation, 1) for node in range(NODES)])
            for inflation in (1.0, INFLATION)
        )
        np.testing.assert_allclose(found.states, expected, atol=2e-3)
        np.testing.assert_allclose(found.references, first, atol=2e-3)
        # Half of unknown material resembles the places of the belief, a quarter each any place.
        unknown = logsumexp([logsumexp(wide), logsumexp(first) - np.log(2), logsumexp(wide) - np.log(2)])
        assert found.unknown == pytest.approx(unknown - np.log(2 * NODES), abs=2e-3)
        off = [
            stats.multivariate_t(np.zeros(size), 1.3 * np.eye(size), df=NU).logpdf(own) - log_constant(size)
            for size, own in zip(counts, model.noise.layout.split(model.whitened(strain)), strict=True)
        ]
        assert found.featureless == pytest.approx(sum(off) + model.noise.log_volume.sum(), abs=2e-3)


def test_the_mixture_drops_an_absent_phalanx() -> None:
    model, used = mixture((3, 5)), np.array([False, True])
    strain = np.random.default_rng(3).standard_normal(8)
    one = evaluated(model, strain, used)
    strain[:3] = 1e6
    other = evaluated(model, strain, used)
    np.testing.assert_array_equal(one.states, other.states)
    np.testing.assert_array_equal(one.references, other.references)
    assert (one.unknown, one.featureless) == (other.unknown, other.featureless)


def test_uncertainty_of_the_level_widens_every_density() -> None:
    model, far = mixture((3, 5)), np.full(8, 300.0)
    sure, unsure = (evaluated(model, far, level_variance=variance) for variance in (0.0, 100.0))
    for one, other in zip(sure, unsure, strict=True):
        assert (np.asarray(other) > one).all()


def test_material_felt_everywhere_is_never_featureless_or_unknown() -> None:
    found = evaluated(mixture((3,), featureless=None), np.zeros(3))
    assert found.featureless == found.unknown == -np.inf


@pytest.mark.parametrize("strain", [1e6, -1e6, 1e12])
def test_outliers_have_a_finite_mixture_density(strain: float) -> None:
    found = evaluated(mixture((3, 5)), np.full(8, strain))
    assert np.isfinite(found.states).all()
    assert np.isfinite(found.unknown)
    assert np.ptp(found.states) < 2 * 0.5 * NU * np.log(4.0), "the variance alone tells places apart"


def test_a_whitened_strain_is_that_of_its_volts() -> None:
    model, volts = mixture((3, 5)), np.random.default_rng(0).standard_normal(8)
    np.testing.assert_allclose(model.in_volts(model.whitened(volts)), volts)
