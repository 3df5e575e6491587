"""The single-Gaussian models, with moments of the nearest pairs and shrinkage."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.scans import scan, scene, strain_at

from tactile_localizer.core.likelihood.gaussian import Gaussian
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import MeasurementError, ParameterError
from tactile_localizer.sim import simulate_scan

STATE = np.array([0.021, 0.033])


@pytest.fixture(scope="module")
def small():
    """A scan and its model, shared by the tests."""
    made = scan(np.random.default_rng(1), scene(), 200)
    return made, Gaussian(made, scene(), 8)


def nearest(of, made, state, k):
    """Rows of the k pairs nearest to a state, in units of the extents of the axes."""
    distance = np.linalg.norm((made.states - state) / (of.upper - of.lower), axis=1)
    return np.argsort(distance)[:k]


def quadratic(model, state, mean):
    """Precision matrix of a log-density about its mean, from its values alone."""
    size, step = len(mean), 0.02
    unit = np.eye(size) * step

    def value(offset):
        return float(model.log_likelihood(state[None], mean + offset)[0])

    peak = value(np.zeros(size))
    diagonal = np.array([2 * peak - value(e) - value(-e) for e in unit]) / step**2
    precision = np.diag(diagonal)
    for i in range(size):
        for j in range(i):
            both = (2 * peak - value(unit[i] + unit[j]) - value(-unit[i] - unit[j])) / step**2
            precision[i, j] = precision[j, i] = 0.5 * (both - diagonal[i] - diagonal[j])
    return precision, peak


@pytest.mark.parametrize("phalanges", [1, 2])
@pytest.mark.parametrize("k", [2, 8, 30])
def test_the_density_is_a_gaussian_of_the_nearest_pairs(k, phalanges):
    """The peak of the density agrees with its precision, and the regularization is the same everywhere."""
    of = scene(2, phalanges)
    made = scan(np.random.default_rng(1), of, 600, noise=0.05)
    model = Gaussian(made, of, k)
    shares = []
    for state in (STATE, np.array([0.04, 0.01])):
        rows = nearest(of, made, state, k)
        mean, covariance = made.strain[rows].mean(axis=0), np.cov(made.strain[rows].T, bias=True)
        precision, peak = quadratic(model, state, mean)
        assert np.linalg.eigvalsh(precision).min() > 0
        expected = 0.5 * np.linalg.slogdet(precision / (2 * math.pi))[1] - math.log(1.01)
        assert peak == pytest.approx(expected, abs=0.02)
        found = np.linalg.inv(precision) / model.shrinkage.scale
        shares.append(found - (1 - model.shrinkage.intensity) * covariance)
    np.testing.assert_allclose(shares[0], shares[1], atol=0.03 * np.abs(shares[0]).max())
    assert np.linalg.eigvalsh(shares[0]).min() > 0


@pytest.mark.parametrize("k", [1, 8, 20])
def test_independent_phalanges_multiply(k):
    of = scene()
    made = scan(np.random.default_rng(1), of, 300)
    model = Gaussian(made, of, k, independent=True)
    states = of.lower + np.random.default_rng(2).random((40, 2)) * 0.05
    measured = strain_at(STATE[None])[0]
    apart = [model.log_likelihood(states, measured, present) for present in np.eye(2, dtype=bool)]
    # The floor is mixed in once, not once a phalanx: compare where it does not matter.
    together = model.log_likelihood(states, measured)
    near = together > together.max() - 10
    np.testing.assert_allclose(together[near], sum(apart)[near], atol=0.05)


def test_correlated_phalanges_do_not_multiply():
    """With noise common to both fingers the joint density exceeds the product of both."""
    of = scene()
    rng = np.random.default_rng(0)
    made = scan(rng, of, 2000, noise=0.01)
    tremor = 0.2 * rng.standard_normal((2000, 1))
    made = Scan(made.states, made.strain + tremor, made.sweep, made.axes, made.phalanges)
    measured = strain_at(STATE[None])[0] + 0.2
    joint, independent = (
        Gaussian(made, of, 30, independent=i).log_likelihood(STATE[None], measured)[0] for i in (False, True)
    )
    assert joint > independent + 1.0


@pytest.mark.parametrize("intensity", [0.02, 1.0])
def test_the_chosen_shrinkage_explains_new_sweeps_best(intensity, monkeypatch):
    of = scene()
    train, test = (simulate_scan("bump", 1, kind).to_scan() for kind in ("train", "test"))
    rows = np.linspace(0, len(test) - 1, 300).astype(int)

    def explained():
        model = Gaussian(train, of, 8)
        return [model.log_likelihood(test.states[row][None], test.strain[row])[0] for row in rows]

    chosen = np.median(explained())
    monkeypatch.setattr("tactile_localizer.core.likelihood.gaussian._INTENSITIES", (intensity,))
    assert chosen > np.median(explained()) + 0.5


def test_distances_of_new_sweeps_are_calibrated():
    of = scene()
    train, test = (simulate_scan("bump", 1, kind).to_scan() for kind in ("train", "test"))
    model = Gaussian(train, of, 8)
    rows = np.linspace(0, len(test) - 1, 300).astype(int)
    squared = []
    for row in rows:
        neighbours = train.strain[nearest(of, train, test.states[row], 8)]
        peak = model.log_likelihood(test.states[row][None], neighbours.mean(axis=0))[0]
        squared.append(2 * (peak - model.log_likelihood(test.states[row][None], test.strain[row])[0]))
    assert 0.4 < np.median(squared) / 15.3 < 3.0  # 15.3: median of chi-square with 16 degrees of freedom


@pytest.mark.parametrize("pairs", [1, 2, 5])
@pytest.mark.parametrize("k", [1, 8, 10_000])
@pytest.mark.parametrize("independent", [False, True])
def test_densities_are_finite_for_any_k(pairs, k, independent):
    of = scene()
    made = scan(np.random.default_rng(1), of, pairs, sweeps=1)
    values = Gaussian(made, of, k, independent).log_likelihood(
        np.random.default_rng(0).random((10, 2)), made.strain[0]
    )
    assert np.isfinite(values).all()


@pytest.mark.parametrize("k", [1, 8, 50])
def test_duplicate_pairs_give_finite_densities(k):
    of = scene()
    made = scan(np.random.default_rng(1), of, 3, sweeps=1)
    rows = np.repeat(np.arange(3), 100)
    made = Scan(made.states[rows], made.strain[rows], np.arange(300) // 30, made.axes, made.phalanges)
    model = Gaussian(made, of, k)
    assert np.isfinite(model.log_likelihood(made.states[::50], made.strain[0])).all()
    best = model.log_likelihood(made.states[[0, 100, 200]], made.strain[0])
    assert np.argmax(best) == 0


@given(seed=st.integers(0, 2**32 - 1), away=st.sampled_from([0.0, 1e3, 1e6, 1e9]))
def test_outliers_have_a_finite_density(small, seed, away):
    made, model = small
    measured = made.strain[0] + away * np.random.default_rng(seed).standard_normal(16)
    assert np.isfinite(model.log_likelihood(made.states[:20], measured)).all()


def test_gaussian_drops_an_absent_phalanx(small):
    made, model = small
    measured = made.strain[10].copy()
    states = made.states[:30]
    present = np.array([True, False])
    before = model.log_likelihood(states, measured, present)
    measured[8:] = np.nan
    np.testing.assert_array_equal(model.log_likelihood(states, measured, present), before)
    with pytest.raises(MeasurementError):
        model.log_likelihood(states, measured)


def test_neighbours_are_found_across_the_wrap():
    of = scene(3, full_turn=True)
    made = scan(np.random.default_rng(1), of, 2000)
    model = Gaussian(made, of, 4)
    one, other = np.array([[0.02, 0.02, math.pi - 1e-6]]), np.array([[0.02, 0.02, -math.pi + 1e-6]])
    measured = strain_at(one)[0]
    assert model.log_likelihood(one, measured)[0] == pytest.approx(
        model.log_likelihood(other, measured)[0], abs=1e-3
    )


def test_fewer_than_one_neighbour_is_refused(small):
    with pytest.raises(ParameterError, match="neighbours: expected at least 1, got 0"):
        Gaussian(small[0], scene(), 0)
