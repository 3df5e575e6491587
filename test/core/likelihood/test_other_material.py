"""Other material of any strength, the alternative to the map."""

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad
from scipy.special import gammaln

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.likelihood.other_material import PATCH_LENGTH, OtherMaterial
from tactile_localizer.core.likelihood.student_t import DEGREES_OF_FREEDOM as NU
from tactile_localizer.core.likelihood.student_t import log_density

LAYOUT = ChannelLayout((3, 1))
SIGNAL = np.zeros((4, 4))
SIGNAL[:3, :3] = 40.0 * np.array([[2.0, 1.0, 0.0], [1.0, 2.0, 0.5], [0.0, 0.5, 1.0]])
SIGNAL[3, 3] = 40.0
MATERIAL = OtherMaterial(LAYOUT, SIGNAL, np.full(LAYOUT.phalanges, 1.3))
NONE, BOTH = np.zeros(2), np.ones(2, dtype=bool)
EXPONENT, TRAVEL = 0.3, 0.0005


def log_constant(channels: int) -> float:
    """Constant of the t-density, omitted as in the likelihoods of the map."""
    return float(gammaln((NU + channels) / 2) - gammaln(NU / 2) - channels / 2 * np.log(NU * np.pi))


def after(material: OtherMaterial, innovations: np.ndarray) -> np.ndarray:
    """Probabilities (G, F) of the strengths after innovations (n, C)."""
    weights = material.start()
    for innovation in innovations:
        _, weights = material.update(weights, innovation, NONE, BOTH, TRAVEL, EXPONENT)
    return weights


def test_its_likelihood_is_a_density() -> None:
    """One channel; whatever the level, the map and the weights of the strengths are."""
    material = OtherMaterial(ChannelLayout((1,)), np.array([[40.0]]), np.array([1.3]))
    weights = np.random.default_rng(0).dirichlet(np.ones(len(material.start())))[:, None]

    def density(strain: float) -> float:
        innovation, one = np.array([strain]), np.ones(1)
        total, _ = material.update(weights, innovation, 0.7 * one, one.astype(bool), TRAVEL, 1.0)
        return float(np.exp(total + log_constant(1)))

    assert quad(density, -np.inf, np.inf, limit=200)[0] == pytest.approx(1.0, abs=1e-6)


def test_without_a_signal_it_is_featureless_material() -> None:
    featureless = np.zeros_like(MATERIAL.start())
    featureless[0] = 1.0
    innovation, level = np.array([1.0, -2.0, 0.5, 3.0]), np.array([0.7, 0.0])
    total, _ = MATERIAL.update(featureless, innovation, level, BOTH, TRAVEL, EXPONENT)
    expected = sum(
        stats.multivariate_t(np.zeros(size), variance * np.eye(size), df=NU).logpdf(own) - log_constant(size)
        for size, variance, own in zip(LAYOUT.counts, 1.3 + level, LAYOUT.split(innovation), strict=True)
    )
    assert total == pytest.approx(expected)


def test_strengths_follow_the_signal_of_each_phalanx_and_are_forgotten() -> None:
    rng = np.random.default_rng(0)
    like_the_map = rng.multivariate_normal(np.zeros(4), SIGNAL, 400)
    still = np.sqrt(1.3) * rng.standard_normal((400, 4))
    first = np.concatenate([like_the_map[:, :3], still[:, 3:]], axis=1)
    second = np.concatenate([still[:, :3], like_the_map[:, 3:]], axis=1)
    for series, strengths in (
        (first, [4, 0]),
        (second, [0, 4]),
        (np.concatenate([first, second]), [0, 4]),
    ):
        np.testing.assert_array_equal(after(MATERIAL, series).argmax(axis=0), strengths)


def test_after_the_length_of_a_patch_its_strength_may_be_any() -> None:
    before = np.random.default_rng(0).dirichlet(np.ones(len(MATERIAL.start())), 2).T
    _, found = MATERIAL.update(before, np.zeros(4), NONE, BOTH, PATCH_LENGTH, 0.0)
    kept = np.exp(-1.0)
    np.testing.assert_allclose(found, kept * before + (1.0 - kept) / len(before))


@pytest.mark.parametrize("volts", [1e2, 1e4, 1e8])
def test_a_strain_in_another_unit_is_other_material_however_uncertain_a_place_of_the_map_is(
    volts: float,
) -> None:
    """Far off in every direction, also in those in which the map has no signal."""
    strain = volts * np.random.default_rng(0).standard_normal(4)
    total, _ = MATERIAL.update(MATERIAL.start(), strain, NONE, BOTH, TRAVEL, EXPONENT)
    signal = np.array([np.linalg.eigvalsh(SIGNAL[own, own]).max() for own in LAYOUT.slices])
    variance = 0.5 * signal
    there = log_density(LAYOUT.sum(strain**2) / variance, variance, variance, LAYOUT.widths).sum()
    assert total > there


def test_a_signal_in_a_direction_in_which_the_map_has_none_is_other_material_too() -> None:
    material, one = OtherMaterial(ChannelLayout((2,)), np.diag([40.0, 0.0]), np.array([1.3])), np.ones(1)
    along, across = (
        material.update(material.start(), strain, 0.0 * one, one.astype(bool), TRAVEL, EXPONENT)[0]
        for strain in 30.0 * np.eye(2)
    )
    assert across > along - 5.0


def test_a_phalanx_that_does_not_count_changes_nothing() -> None:
    first, start = np.array([True, False]), MATERIAL.start()
    one, other = (np.array([1.0, 2.0, 3.0, last]) for last in (0.0, 1e6))
    found = [MATERIAL.update(start, strain, NONE, first, TRAVEL, EXPONENT) for strain in (one, other)]
    assert found[0][0] == found[1][0]
    for _, weights in found:
        np.testing.assert_array_equal(weights[:, 1], start[:, 1])


def test_it_is_the_same_material_in_other_coordinates() -> None:
    """Of a phalanx that is whitened anew the determinant of the transform is left."""
    rotation = stats.ortho_group.rvs(3, random_state=0)
    transform = np.eye(4)
    transform[:3, :3] = rotation
    innovation, start = np.array([1.0, -20.0, 5.0, 3.0]), MATERIAL.start()
    plain, _ = MATERIAL.update(start, innovation, NONE, BOTH, TRAVEL, EXPONENT)
    turned = MATERIAL.transformed(transform)
    moved, _ = turned.update(start, transform @ innovation, NONE, BOTH, TRAVEL, EXPONENT)
    assert moved == pytest.approx(plain)
