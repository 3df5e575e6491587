"""The position-blind explanation of a strain: featureless material, or material that was never scanned."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.special import logsumexp

from tactile_localizer.core.fit import HeldOutFit
from tactile_localizer.core.likelihood.kernels.background import Background
from tactile_localizer.core.null_model import NullModel

BOTH, INDEX = np.ones(2, bool), np.array([True, False])
RNG = np.random.default_rng(0)
SWEEP = np.repeat(np.arange(10), 200)
OFFSETS = 0.05 * RNG.standard_normal((10, 16))
STRAIN = OFFSETS[SWEEP] + 0.02 * RNG.standard_normal((2000, 16)) @ (np.eye(16) + 0.3)
FEATURELESS = np.arange(2000) % 200 < 150
STRAIN[~FEATURELESS] += 1.0
BACKGROUND = Background(STRAIN, np.full(16, 0.03))
UNKNOWN = HeldOutFit(-20.0, np.array([-8.0, -14.0]))


def null(unknown=None, featureless=FEATURELESS):
    return NullModel(STRAIN, SWEEP, featureless, BACKGROUND, unknown)


def test_featureless_is_an_even_mixture_of_known_sweeps_and_a_new_one():
    """Written out: a normal about each sweep's own mean, and one whose mean is uncertain."""
    felt, sweep = STRAIN[FEATURELESS], SWEEP[FEATURELESS]
    means = np.array([felt[sweep == number].mean(axis=0) for number in range(10)])
    within = np.cov((felt - means[sweep]).T, bias=True)
    between = np.cov(means.T, bias=True)
    ridge = 0.05 * np.diag(np.diag(within) + np.diag(between))
    measured = STRAIN[3]
    known = logsumexp(
        [stats.multivariate_normal(mean, within + ridge).logpdf(measured) for mean in means]
    ) - np.log(10)
    new = stats.multivariate_normal(felt.mean(axis=0), within + 1.1 * between + ridge).logpdf(measured)
    assert null().featureless(measured, BOTH) == pytest.approx(np.logaddexp(known, new) - np.log(2), abs=0.01)


def test_what_is_felt_on_the_feature_does_not_count_as_featureless():
    clean = null().featureless(STRAIN[FEATURELESS][5], BOTH)
    assert clean > null().featureless(STRAIN[~FEATURELESS][5], BOTH) + 50
    assert clean > null(featureless=np.ones(2000, bool)).featureless(STRAIN[FEATURELESS][5], BOTH)


def test_without_featureless_pairs_the_whole_scan_stands_in():
    none, every = (null(featureless=np.full(2000, flag)) for flag in (False, True))
    assert none.featureless(STRAIN[0], BOTH) == every.featureless(STRAIN[0], BOTH)


def test_the_better_explanation_counts():
    felt, strange = STRAIN[FEATURELESS][0], np.full(16, 3.0)
    assert null().log_density(felt, BOTH) == null().featureless(felt, BOTH)
    assert null().log_density(strange, BOTH) == BACKGROUND.log_density(strange, BOTH)
    assert null(UNKNOWN).log_density(strange, BOTH) == max(-20.0, BACKGROUND.log_density(strange, BOTH))


def test_an_absent_phalanx_counts_nowhere():
    measured = STRAIN[0].copy()
    whole = null(UNKNOWN)
    before = whole.log_density(measured, INDEX), whole.featureless(measured, INDEX)
    measured[8:] = 1e6
    assert (whole.log_density(measured, INDEX), whole.featureless(measured, INDEX)) == before
    alone = NullModel(STRAIN[:, :8], SWEEP, FEATURELESS, Background(STRAIN[:, :8], np.full(8, 0.03)))
    assert whole.featureless(measured, INDEX) == pytest.approx(alone.featureless(measured[:8], INDEX[:1]))


@given(away=st.floats(0, 1e12), seed=st.integers(0, 2**32 - 1))
def test_any_strain_has_a_finite_density(away, seed):
    measured = away * np.random.default_rng(seed).standard_normal(16)
    assert np.isfinite(null(UNKNOWN).log_density(measured, BOTH))


@pytest.mark.parametrize("pairs", [1, 2, 5])
@pytest.mark.parametrize("scale", [0.0, 1e-9, 1.0, 1e9])
def test_few_or_equal_pairs_still_give_a_density(pairs, scale):
    strain = scale * np.ones((pairs, 16))
    model = NullModel(strain, np.arange(pairs), np.ones(pairs, bool), Background(strain, np.full(16, 0.03)))
    assert np.isfinite(model.log_density(strain[0], BOTH))


def test_the_blur_of_kernels_is_what_a_featureless_strain_is_lifted_by() -> None:
    widths = np.full(16, 0.03)
    blurred = NullModel(STRAIN, SWEEP, FEATURELESS, BACKGROUND, blur=widths)
    own = STRAIN[FEATURELESS & (SWEEP == 0)]
    strain, within = own.mean(axis=0), np.cov(own.T)
    credit = blurred.credit(strain, BOTH)
    assert credit.featureless == null().featureless(strain, BOTH)
    lost = 0.5 * (np.linalg.slogdet(within + np.diag(widths**2))[1] - np.linalg.slogdet(within)[1])
    assert credit.best - credit.blurred == pytest.approx(lost, rel=0.3), "but for the other sweeps"
    assert null().credit(strain, BOTH).blurred == credit.featureless, "a model that does not blur"


def test_a_strain_unlike_featureless_material_is_not_lifted() -> None:
    blurred = NullModel(STRAIN, SWEEP, FEATURELESS, BACKGROUND, blur=np.full(16, 0.03))
    credit = blurred.credit(STRAIN.max(axis=0) + 1.0, BOTH)
    assert credit.best == credit.blurred


@given(away=st.floats(0.0, 6.0), seed=st.integers(0, 2**32 - 1))
def test_a_featureless_strain_in_the_tails_is_explained_as_well_as_a_blurred_map_does(away, seed) -> None:
    widths = np.full(16, 0.03)
    blurred = NullModel(STRAIN, SWEEP, FEATURELESS, BACKGROUND, blur=widths)
    felt, sweep = STRAIN[FEATURELESS], SWEEP[FEATURELESS]
    means = np.array([felt[sweep == number].mean(axis=0) for number in range(10)])
    within = np.cov((felt - means[sweep]).T, bias=True)
    strain = means[0] + away * np.sqrt(np.diag(within)) * np.random.default_rng(seed).standard_normal(16)
    by_map = stats.multivariate_normal(means[0], 1.05 * within + np.diag(widths**2)).logpdf(strain)
    shares = np.log(2.0 * 10.0)  # the sweep is one of ten, and known sweeps are half of the mixture
    assert blurred.credit(strain, BOTH).best >= by_map - shares - 1.0
    assert blurred.credit(strain, BOTH).best >= null().featureless(strain, BOTH)
