"""Densities of the sweep mixture, from given tables."""

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import trapezoid
from scipy.special import gammaln, logsumexp

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.likelihood.evaluation import INFLATION, Evaluation
from tactile_localizer.core.likelihood.noise_model import NoiseModel
from tactile_localizer.core.likelihood.strain_map import StrainMap
from tactile_localizer.core.likelihood.student_t import DEGREES_OF_FREEDOM as NU
from tactile_localizer.core.likelihood.sweep_mixture import SweepMixture

NODES, COMPONENTS = 30, 3
STATES = (np.arange(NODES) + 0.5)[:, None] * 0.001
ONE, NONE = np.ones(1, bool), np.zeros(1)


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
        np.array([0.0005]), np.array([0.001]), (nodes,), *tables, featureless, np.zeros((1, size))
    )
    volume = np.array(counts) * np.log(0.25)
    noise = NoiseModel(layout, np.full(size, 0.1), 0.25 * np.eye(size), volume, *np.zeros((2, size)))
    return SweepMixture(noise, strain_map, np.array([0.001]), 0.002, 0.006, None)


def log_constant(channels: int) -> float:
    """Constant of the t-density, omitted for all alternatives."""
    return float(gammaln((NU + channels) / 2) - gammaln(NU / 2) - channels / 2 * np.log(NU * np.pi))


def direct(model: SweepMixture, node: int, strain: np.ndarray, inflation: float = 1.0) -> float:
    """The density at a node in volts, by scipy and float64."""
    total = 0.0
    for phalanx, own in enumerate(model.noise.layout.slices):
        terms, size = [], own.stop - own.start
        for component in range(COMPONENTS if inflation == 1.0 else 1):
            shape = inflation * float(model.map.variance[node, component, phalanx])
            mean = model.map.mean[node, component, own].astype(np.float64)
            density = stats.multivariate_t(mean, shape * np.eye(size), df=NU).logpdf(strain[own])
            prior = model.map.log_prior[node, component] if inflation == 1.0 else 0.0
            terms.append(float(prior) + density)
        total += float(logsumexp(terms)) + float(model.noise.log_volume[phalanx]) - log_constant(size)
    return total


@pytest.mark.parametrize("alternative", ["position", "other_material", "elsewhere", "featureless"])
def test_every_alternative_integrates_to_one(alternative: str) -> None:
    model = mixture((1,))

    def density(volts: float) -> float:
        found = model.evaluate(STATES[7:8], model.whitened(np.array([volts])), ONE, NONE)
        return float(np.exp(np.sum(getattr(found, alternative)) + log_constant(1)))

    strain = np.linspace(-400.0, 400.0, 2_001)
    total = trapezoid([density(volts) for volts in strain], strain)
    assert total == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("counts", [(1,), (3, 5), (8, 8)])
def test_float32_tables_agree_with_direct_evaluation(counts: tuple[int, ...]) -> None:
    model, rng = mixture(counts), np.random.default_rng(1)
    used, known = np.ones(len(counts), bool), np.zeros(len(counts))
    for scale in (1.0, 10.0, 1e3):
        strain = scale * rng.standard_normal(sum(counts))
        found = model.evaluate(STATES, strain, used, known)
        expected = [direct(model, node, strain) for node in range(NODES)]
        inflated = [direct(model, node, strain, INFLATION) for node in range(NODES)]
        np.testing.assert_allclose(found.position, expected, atol=2e-3)
        np.testing.assert_allclose(found.other_material, inflated, atol=2e-3)


def over_all_places(found: Evaluation) -> float:
    """Mean over the states, with their variance and with the larger one."""
    both = np.concatenate([found.position, found.other_material])
    return float(logsumexp(both) - np.log(len(both)))


def test_elsewhere_is_the_average_over_all_places() -> None:
    model = mixture((3, 5))
    strain, used = np.random.default_rng(2).standard_normal(8), np.ones(2, bool)
    found = model.evaluate(STATES, strain, used, np.zeros(2))
    assert found.elsewhere == pytest.approx(over_all_places(found), abs=0.5)


def test_elsewhere_of_a_large_map_is_sampled() -> None:
    model, strain = mixture((3, 5), nodes=4_000), np.random.default_rng(2).standard_normal(8)
    states = 0.001 * np.arange(0.5, 4_000.0)[:, None]
    found = model.evaluate(states, strain, np.ones(2, bool), np.zeros(2))
    assert found.elsewhere == pytest.approx(over_all_places(found), abs=1.0)


def test_the_mixture_drops_an_absent_phalanx() -> None:
    model = mixture((3, 5))
    strain, used = np.random.default_rng(3).standard_normal(8), np.array([False, True])
    one = model.evaluate(STATES, strain, used, np.zeros(2))
    strain[:3] = 1e6
    other = model.evaluate(STATES, strain, used, np.zeros(2))
    np.testing.assert_array_equal(one.position, other.position)
    assert one.featureless == other.featureless
    assert one.elsewhere == other.elsewhere


def test_uncertainty_of_the_offset_widens_the_density() -> None:
    model, far = mixture((3, 5)), np.full(8, 30.0)
    sure, unsure = (model.evaluate(STATES, far, np.ones(2, bool), np.full(2, v)) for v in (0.0, 100.0))
    assert (unsure.position > sure.position).all()
    assert unsure.featureless > sure.featureless


def test_textured_material_is_never_featureless() -> None:
    model = mixture((3,), featureless=None)
    assert model.evaluate(STATES, np.zeros(3), ONE, NONE).featureless == -np.inf


@pytest.mark.parametrize("strain", [1e6, -1e6, 1e12])
def test_outliers_have_a_finite_mixture_density(strain: float) -> None:
    found = mixture((3, 5)).evaluate(STATES, np.full(8, strain), np.ones(2, bool), np.zeros(2))
    assert np.isfinite(found.position).all()
    assert np.isfinite(found.elsewhere)
    assert np.ptp(found.position) < 2 * 0.5 * NU * np.log(4.0), "the variance alone tells places apart"


def test_expected_strain_is_the_mean_under_the_belief() -> None:
    model, nodes = mixture((3, 5)), [2, 4]
    log_weights = np.log([0.25, 0.75])
    expected = model.expected(np.array(nodes), log_weights, np.zeros(8))
    means, noise = model.map.mean[nodes, 0].astype(float), model.map.variance[nodes, 0].astype(float)
    weights = np.exp(log_weights)
    assert np.allclose(expected.residual, -weights @ means, atol=1e-5)
    assert np.allclose(expected.spread, weights @ (means - weights @ means) ** 2, atol=1e-4)
    assert np.allclose(expected.noise, weights @ noise, atol=1e-5)
