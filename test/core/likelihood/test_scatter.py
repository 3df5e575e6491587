"""Scatter of a sweep's residuals: larger in all directions, in some, or as in the scan."""

import numpy as np
import pytest

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.likelihood.scatter import Scatter, Whitening

LAYOUT = ChannelLayout((8, 4))
USED = np.ones(2, dtype=bool)
WITHIN = np.equal.outer(LAYOUT.phalanx, LAYOUT.phalanx)
MEASUREMENTS = 20.0


def felt(covariance: np.ndarray, strains: int = 400, seed: int = 0, nu: float = 8.0) -> Scatter:
    """The scatter of a sweep whose residuals have a covariance, and the tails of the scan's."""
    rng, scatter = np.random.default_rng(seed), Scatter.start(LAYOUT)
    root = np.linalg.cholesky(covariance)
    for number in range(strains):
        wide = np.sqrt(nu / rng.chisquare(nu))
        residual = wide * (root @ rng.standard_normal(LAYOUT.size))
        share = max(1.0 / (1 + number), 1.0 / 100.0)
        moments = (1.0 - 2.0 / nu) * np.outer(residual, residual) * WITHIN
        scatter = scatter.after(moments, USED, share, min(MEASUREMENTS, 1.0 + number))
    return scatter


def along(direction: np.ndarray, variance: float) -> np.ndarray:
    """Covariance that is larger by a variance along one direction."""
    return np.asarray(np.eye(len(direction)) + variance * np.outer(direction, direction))


def covariance(found: Whitening | None) -> np.ndarray:
    """Covariance that is one after a transform, whose volume is checked."""
    assert found is not None
    volumes = [np.linalg.slogdet(found.transform[own, own])[1] for own in LAYOUT.slices]
    np.testing.assert_allclose(found.log_volume, volumes, atol=1e-9)
    return np.linalg.inv(found.transform.T @ found.transform)


FORCE = np.r_[np.arange(1.0, 9.0) / np.linalg.norm(np.arange(1.0, 9.0)), np.zeros(4)]


@pytest.mark.parametrize("strains", [1, 3, 30, 400])
def test_under_the_conditions_of_the_scan_no_direction_is_larger(strains: int) -> None:
    """But by chance, now and then; all together may be by what few strains have."""
    scatters = [felt(np.eye(12), strains, seed) for seed in range(40)]
    assert sum(each.along(FORCE + 1.0) is not None for each in scatters) <= 8
    found = [covariance(each) for each in (each.whitening(None) for each in scatters) if each is not None]
    assert sum((each != np.diag(each.diagonal())).any() for each in found) <= 4
    if strains == 400:
        assert all(each.max() < 1.5 for each in found)


def test_residuals_that_are_larger_in_all_directions_widen_all_of_a_phalanx() -> None:
    wide = np.diag(np.r_[np.full(8, 9.0), np.full(4, 0.5)])
    scatter = felt(wide)
    np.testing.assert_allclose(scatter.variance, [9.0, 0.5], rtol=0.2)
    found = covariance(scatter.whitening(None))
    np.testing.assert_allclose(found, np.diag(np.r_[np.full(8, 9.0), np.ones(4)]), rtol=0.2)


def test_residuals_that_are_larger_in_one_direction_leave_the_others_as_they_were() -> None:
    found = covariance(felt(along(FORCE, 60.0)).whitening(None))
    assert FORCE @ found @ FORCE == pytest.approx(61.0, rel=0.3)
    across = np.linalg.eigvalsh(found[:8, :8])[:-1]
    np.testing.assert_allclose(across, 1.0, atol=0.3)
    np.testing.assert_allclose(found[8:, 8:], np.eye(4), atol=1e-12)


def test_a_direction_that_is_known_needs_no_search() -> None:
    """A smaller variance is found along it than in any direction; and there may be others."""
    other = np.r_[FORCE[7::-1], np.zeros(4)]
    other -= FORCE * (FORCE @ other)
    other /= np.linalg.norm(other)
    scatter = felt(along(FORCE, 4.0))
    found = covariance(scatter.along(3.0 * FORCE))
    assert FORCE @ found @ FORCE == pytest.approx(5.0, rel=0.3)
    np.testing.assert_allclose(
        found - np.eye(12), (FORCE @ found @ FORCE - 1.0) * np.outer(FORCE, FORCE), atol=1e-12
    )
    assert scatter.along(other) is None
    both = felt(along(FORCE, 30.0) + 50.0 * np.outer(other, other))
    found = covariance(both.whitening(both.along(FORCE)))
    assert FORCE @ found @ FORCE == pytest.approx(31.0, rel=0.4)
    assert other @ found @ other == pytest.approx(51.0, rel=0.4)
    rest = np.linalg.eigvalsh(found[:8, :8])[:6]
    np.testing.assert_allclose(rest, 1.0, atol=0.4)


def test_of_one_channel_no_direction_is_across_and_nothing_is_force() -> None:
    """Else all that is not on the map would be explained by a force."""
    layout = ChannelLayout((1, 1))
    scatter = Scatter.of(layout, np.diag([400.0, 1.0]), MEASUREMENTS)
    assert scatter.along(np.ones(2)) is None
    found = scatter.whitening(None)
    assert found is not None
    np.testing.assert_allclose(found.transform, np.diag([0.05, 1.0]))
    np.testing.assert_allclose(found.log_volume, np.log([0.05, 1.0]))


def test_in_other_units_the_scatter_is_that_of_the_residuals_in_them() -> None:
    rng = np.random.default_rng(1)
    transform = np.tril(rng.uniform(0.5, 1.0, (12, 12))) * WITHIN
    residuals = rng.standard_normal((50, 12))
    moments, moved = ((each.T @ each) / 50.0 * WITHIN for each in (residuals, residuals @ transform.T))
    found = Scatter.of(LAYOUT, moments, MEASUREMENTS).moved(transform)
    expected = Scatter.of(LAYOUT, moved, MEASUREMENTS)
    np.testing.assert_allclose(found.moments, expected.moments)
    np.testing.assert_allclose(found.variance, expected.variance)


def test_few_measurements_have_no_distinct_direction_and_one_variance() -> None:
    """Where the map's own errors are long, another direction is no more certain."""
    moments = along(FORCE, 300.0)
    few, more = (covariance(Scatter.of(LAYOUT, moments, count).whitening(None)) for count in (2.0, 12.0))
    np.testing.assert_allclose(few[:8, :8], (1.0 + 300.0 / 8.0) * np.eye(8), atol=1e-9)
    assert FORCE @ more @ FORCE == pytest.approx(301.0)


def test_a_phalanx_that_does_not_count_keeps_its_scatter() -> None:
    scatter = Scatter.start(LAYOUT).after(4.0 * WITHIN, np.array([True, False]), 0.25, 1.0)
    np.testing.assert_allclose(scatter.moments[:8, :8], 0.75 * np.eye(8) + 1.0)
    np.testing.assert_array_equal(scatter.moments[8:, 8:], np.eye(4))
    np.testing.assert_allclose(scatter.variance, [1.75, 1.0])
    np.testing.assert_allclose(scatter.most**2, [8 * 1.75**2 + 56.0, 4.0])


@pytest.mark.parametrize("size", [1e-200, 1e-3, 1.0, 800.0])
def test_residuals_of_any_size_have_a_finite_covariance(size: float) -> None:
    scatter = Scatter.start(LAYOUT)
    for number in range(5):
        scatter = scatter.after(size * WITHIN, USED, 1.0 / (1 + number), 10.0**-number)
    known = scatter.along(np.full(12, 1e100 / size))
    for found in (known, scatter.whitening(known), scatter.whitening(None)):
        if found is not None:
            assert np.linalg.eigvalsh(covariance(found)).min() > 0.9
    assert scatter.along(np.zeros(12)) is None
