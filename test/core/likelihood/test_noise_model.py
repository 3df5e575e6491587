"""The noise of a visit, and the reproducible part of the strain."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.scans import bump_scan, slides

from tactile_localizer.core.likelihood.drift import innovations
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.noise_model import Visits, WhitenedScan, whiten
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Axis, Phalanx, Region, Scene

LENGTH = 0.2
CLOTH = Scene("cloth", (Axis("x", 0.0, LENGTH),), (Phalanx("index", (0.0,), 4), Phalanx("thumb", (0.0,), 4)))
SHEET = Scene(
    "sheet",
    (Axis("x", 0.0, 0.05), Axis("y", 0.0, 0.05)),
    (Phalanx("index", (0.0, 0.0), 4), Phalanx("thumb", (0.0, 0.0), 4)),
)
MIXING = np.array([[1.0, 0.0, 0.0, 0.0], [0.8, 0.5, 0.0, 0.0], [0.0, 0.3, 2.0, 0.0], [0.0, 0.0, 0.0, 0.1]])
"""Of white noise into the channels of a phalanx."""


def noise(rng: np.random.Generator, count: int) -> np.ndarray:
    return np.hstack([rng.standard_normal((count, 4)) @ MIXING.T for _ in range(2)])


def cloth(repeats: int = 3, seed: int = 0, volts: float = 1.0) -> Scan:
    """Repeats of a slide over a textured material."""
    rng = np.random.default_rng(seed)
    x = np.arange(0.0, LENGTH, 0.0005)
    waves = 6.0 * np.sin(x[:, None] * np.linspace(300.0, 900.0, 8) + np.arange(8.0))
    return slides(CLOTH, x, [volts * (waves + noise(rng, len(x))) for _ in range(repeats)])


def as_cloth(scan: Scan, scene: Scene = CLOTH) -> WhitenedScan:
    """Whitened as a scan whose level wanders."""
    return whiten(Visits.of(scan, scene), Material.CLOTH)


def as_sheet(scan: Scan, scene: Scene = SHEET) -> WhitenedScan:
    """Whitened as a scan whose level is constant."""
    return whiten(Visits.of(scan, scene), Material.SHEET)


@pytest.mark.parametrize(
    ("made", "scene", "material"),
    [(bump_scan(SHEET, offsets=1.0), SHEET, Material.SHEET), (cloth(), CLOTH, Material.CLOTH)],
)
def test_a_large_constant_in_a_channel_changes_nothing(made: Scan, scene: Scene, material: Material) -> None:
    constant = np.full(8, 3e9)  # of noise 1
    scans = [replace(made, strain=made.strain + each) for each in (0.0, constant)]
    plain, moved = (whiten(Visits.of(scan, scene), material) for scan in scans)
    np.testing.assert_allclose(moved.noise.centre - constant, plain.noise.centre, atol=1e-3)
    np.testing.assert_allclose(moved.signal, plain.signal, atol=1e-2)


def test_whitened_residuals_have_unit_covariance() -> None:
    estimate = as_cloth(cloth(4))
    assert estimate.held_out is not None
    expected = estimate.held_out.interpolation.expected(estimate.signal)
    residuals = (estimate.strain - expected.mean[:, 0]) / np.sqrt(1.0 + expected.noise)
    np.testing.assert_allclose(np.cov(residuals.T), np.eye(8), atol=0.3)


def test_phalanges_are_whitened_separately_but_together_where_the_material_is_felt_everywhere() -> None:
    """There the ripple of the force is common to them."""
    sheet = as_sheet(bump_scan(SHEET)).noise
    assert sheet.layout == SHEET.layout
    assert (sheet.whitening[:4, 4:] == 0.0).all()
    assert (sheet.whitening[4:, :4] == 0.0).all()
    joint = as_cloth(cloth()).noise
    assert joint.whitening[4:, :4].any()


def test_a_noisier_sweep_has_the_sum_of_the_covariances() -> None:
    model, excess = as_cloth(cloth()).noise, np.diag([0.0, 2.0, 0.0, 0.0, 50.0, 0.0, 1e9, 0.1])
    excess[1, 4] = excess[4, 1] = 9.0
    usual = np.linalg.inv(model.whitening)
    np.testing.assert_allclose(model.variance, np.diag(usual @ usual.T))
    expected = model.whitening @ (usual @ usual.T + excess) @ model.whitening.T
    np.testing.assert_allclose(model.with_excess(excess), expected, atol=1e-6)


def test_of_many_channels_the_directions_in_which_the_scan_differs_are_left() -> None:
    """Whatever the unit of one of them."""
    scene = replace(SHEET, phalanges=(Phalanx("index", (0.0, 0.0), 40), Phalanx("thumb", (0.0, 0.0), 3)))
    unit = np.where(np.arange(43) == 5, 1e-3, 1.0)
    made = bump_scan(scene)
    plain, scaled = (as_sheet(replace(made, strain=made.strain * by), scene) for by in (1.0, unit))
    assert plain.noise.layout.counts == (8, 3)
    np.testing.assert_allclose(plain.noise.whitening @ plain.noise.inverse, np.eye(11), atol=1e-9)
    at = np.linalg.norm(plain.tracks.positions - 0.025, axis=1).argmin()
    felt, peak = 30.0 * np.linspace(-1.0, 1.0, 43), plain.signal[at]
    np.testing.assert_allclose(plain.noise.whitening @ felt, peak, atol=0.1 * np.linalg.norm(peak))
    np.testing.assert_allclose(np.linalg.norm(scaled.signal[at]), np.linalg.norm(peak), rtol=0.02)
    np.testing.assert_allclose(scaled.noise.variance, plain.noise.variance * unit**2, rtol=0.1)


def test_the_volume_is_the_determinant_of_the_whitening() -> None:
    model = as_cloth(cloth()).noise
    assert model.log_volume.sum() == pytest.approx(np.linalg.slogdet(model.whitening)[1])


@settings(max_examples=8)
@given(st.sampled_from([1e-9, 1e-3, 1e9]), st.integers(0, 3))
def test_whitened_strains_do_not_depend_on_the_unit(volts: float, seed: int) -> None:
    one, other = (as_cloth(cloth(2, seed, unit)) for unit in (1.0, volts))
    np.testing.assert_allclose(other.signal, one.signal, atol=1e-5)
    np.testing.assert_allclose(other.noise.log_volume, one.noise.log_volume - 4 * np.log(volts), atol=1e-5)


@pytest.mark.parametrize("sigma", [0.01, 2.0, 4.0, 6.0])
def test_of_a_noisy_map_that_part_is_expected_which_is_reproduced(sigma: float) -> None:
    """The slope of one sweep on the mean of two others, from the energies of their innovations."""
    rng, x = np.random.default_rng(0), np.arange(0.0, LENGTH, 0.0005)
    waves = 6.0 * np.sin(x[:, None] * np.linspace(300.0, 900.0, 8) + np.arange(8.0))
    noises = [sigma * rng.standard_normal(waves.shape) for _ in range(3)]
    estimate = as_cloth(slides(CLOTH, x, [waves + each for each in noises]))
    memory, pitch = estimate.material.memory, 0.0005
    signal, noise = (np.mean(innovations(each, memory, pitch)[20:] ** 2) for each in (waves, noises[0]))
    fraction = np.sum(estimate.signal * estimate.strain) / np.sum(estimate.strain**2)
    assert fraction == pytest.approx(signal / (signal + noise / 2.0), abs=0.05)


@pytest.mark.parametrize("channels", [slice(3, 4), slice(None)])
@pytest.mark.parametrize("volts", [1e2, 1e3, 1e6])
def test_one_absurd_strain_of_a_scan_does_not_shrink_its_map(channels: slice, volts: float) -> None:
    plain = cloth()
    strain = plain.strain.copy()
    strain[150, channels] = volts
    estimates = [as_cloth(replace(plain, strain=each)) for each in (plain.strain, strain)]
    kept = [np.median(each.signal[:, 0] / each.strain[:, 0]) for each in estimates]
    assert kept[1] == pytest.approx(kept[0], abs=0.05)


def test_featureless_places_are_exactly_equal() -> None:
    estimate = as_sheet(bump_scan(SHEET))
    away = np.abs(estimate.tracks.positions - 0.025)
    assert estimate.signal[np.linalg.norm(away, axis=1) > 0.018].any(axis=1).mean() < 0.1
    middle = (estimate.tracks.number == 10) & (away[:, 0] < 0.002)
    assert estimate.signal[middle].any(axis=1).all()


def test_where_the_material_is_felt_everywhere_a_level_cannot_be_told_from_a_place() -> None:
    estimate = as_cloth(cloth())
    assert not estimate.levels.any()
    assert np.isinf(estimate.noise.level_variance).all()


def test_on_cloth_featureless_strain_does_not_turn_with_yaw() -> None:
    fingers = tuple(Phalanx(name, (0.0, 0.0), 4) for name in CLOTH.phalanx_names)
    turned = Scene("cloth", (*CLOTH.axes, Axis("yaw", -0.1, 0.1)), fingers)
    made, yaw = cloth(), np.array([-0.1, 0.0, 0.1])
    scan = replace(made, states=np.column_stack([made.states, yaw[made.sweep]]), axes=("x", "yaw"))
    estimate = as_cloth(replace(scan, strain=made.strain + 50.0 * yaw[made.sweep, None]), turned)
    assert not estimate.noise.turning.any()


def test_levels_of_sweeps_are_removed_and_those_of_a_new_session_are_twice_as_large() -> None:
    estimate = as_sheet(bump_scan(SHEET, offsets=5.0))
    assert estimate.levels.std(axis=0).mean() == pytest.approx(5.0, rel=0.3)
    variance = np.var(estimate.levels @ estimate.noise.whitening.T, axis=0, ddof=1)
    assert estimate.noise.level_variance.mean() == pytest.approx(2.0**2 * variance.mean())


def test_strains_outside_the_region_are_zero() -> None:
    scene = replace(SHEET, feature=Region((0.025, 0.0), (0.05, 0.05)))
    estimate = as_sheet(bump_scan(SHEET), scene)
    assert (estimate.signal[estimate.tracks.positions[:, 0] < 0.025] == 0.0).all()


def test_a_touch_down_that_differs_between_sweeps_does_not_inflate_the_noise() -> None:
    scan = cloth()
    start = scan.states[:, 0] < 0.01
    spoiled = scan.strain + np.where(start, 50.0, 0.0)[:, None] * (1.0 + scan.sweep[:, None])
    rough = as_cloth(replace(scan, strain=spoiled)).noise
    plain = as_cloth(scan).noise
    np.testing.assert_allclose(rough.log_volume, plain.log_volume, atol=1.0)


def test_the_variance_of_a_channel_counts_the_directions_that_are_left_out() -> None:
    """Of 32 channels with independent noise, eight directions hold a quarter of it."""
    phalanx = Phalanx("index", (0.0,), 32)
    scene = Scene("line", (Axis("x", 0.0, LENGTH, 0.003),), (phalanx,))
    rng, x = np.random.default_rng(0), np.arange(0.0, LENGTH, 0.0005)
    felt = [rng.standard_normal((len(x), 32)) for _ in range(3)]
    variance = whiten(Visits.of(slides(scene, x, felt), scene), Material.CLOTH).noise.variance
    np.testing.assert_allclose(variance, 1.0, rtol=0.5)
