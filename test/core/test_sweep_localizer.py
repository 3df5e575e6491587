"""The sweep mixture, from a scan to a converged position, on strips whose strain is known in closed form."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Axis, Phalanx, Scene

LENGTH = 0.3
STEP = 0.0005
NOISE_V = 0.05
CONFIGURATION = Configuration()
SCENE = Scene("strip", (Axis("x", 0.0, LENGTH),), (Phalanx("index", (0.0,)), Phalanx("middle", (0.0,))))


def strain(x: np.ndarray, material: int, rng: np.random.Generator) -> np.ndarray:
    """Waves with wavelengths of 5 to 40 mm that differ between materials, with noise, (n, 16) V."""
    waves = np.random.default_rng(material)
    frequency, phase = waves.uniform(150.0, 1200.0, (16, 4)), waves.uniform(0.0, 6.28, (16, 4))
    clean = 0.1 * np.sin(x[:, None, None] * frequency + phase).sum(axis=2)
    return np.asarray(clean + NOISE_V * rng.standard_normal(clean.shape))


def strip_scan(material: int = 1, sweeps: int = 2, volts: float = 1.0) -> Scan:
    rng = np.random.default_rng(10 + material)
    x = np.tile(np.arange(0.0, LENGTH, STEP), sweeps)
    sweep = np.repeat(np.arange(sweeps), len(x) // sweeps)
    return Scan(x[:, None], volts * strain(x, material, rng), sweep, ("x",), ("index", "middle"))


def slide(
    localizer: Localizer,
    start: float,
    travel: float = 0.1,
    material: int = 1,
    change: np.ndarray | float = 0.0,
    volts: float = 1.0,
    seed: int = 5,
) -> tuple[np.ndarray, list[Estimate]]:
    """Errors (n,), m, and estimates along a sweep from ``start`` whose strains are off by ``change``."""
    x = start + np.arange(0.0, travel, STEP)
    felt = volts * (strain(x, material, np.random.default_rng(seed)) + change)
    estimates = [
        localizer.update(10_000_000 * i, np.array([0.7 + xi - start]), row)
        for i, (xi, row) in enumerate(zip(x, felt, strict=True))
    ]
    return np.array([float(e.mean[0]) for e in estimates]) - x, estimates


@pytest.fixture(scope="module")
def built() -> Localizer:
    return build_localizer(strip_scan(), SCENE, CONFIGURATION, np.random.default_rng(0))


@pytest.fixture
def localizer(built: Localizer) -> Localizer:
    built.reset()
    return built


@pytest.mark.parametrize("start", [0.01, 0.08, 0.17])
def test_a_sweep_from_an_unknown_start_converges_to_its_place(localizer: Localizer, start: float) -> None:
    errors, estimates = slide(localizer, start)
    assert estimates[-1].converged
    assert abs(errors[-1]) < 0.001
    assert not any(e.converged and abs(error) > 0.005 for error, e in zip(errors, estimates, strict=True))


@pytest.mark.parametrize("gain", [0.75, 1.0, 1.3])
@pytest.mark.parametrize("offset", [0.0, 3.0, 30.0])
def test_a_sweep_of_another_session_converges_to_its_place(
    localizer: Localizer, offset: float, gain: float
) -> None:
    """Another tare, in noise widths, and another squeezing force."""
    change = offset * NOISE_V * np.random.default_rng(3).choice([-1.0, 1.0], 16)
    errors, estimates = slide(localizer, 0.1, change=change, volts=gain)
    assert estimates[-1].converged
    assert abs(errors[-1]) < 0.001
    assert not any(e.converged and abs(error) > 0.005 for error, e in zip(errors, estimates, strict=True))


@pytest.mark.parametrize("material", [2, 3, 4])
@pytest.mark.parametrize("gain", [0.3, 1.0])
def test_another_material_of_another_session_never_converges(
    localizer: Localizer, material: int, gain: float
) -> None:
    _, estimates = slide(localizer, 0.05, material=material, change=30.0 * NOISE_V, volts=gain)
    assert not any(estimate.converged for estimate in estimates)


@pytest.mark.parametrize("material", [2, 3, 4])
def test_another_material_never_converges(localizer: Localizer, material: int) -> None:
    _, estimates = slide(localizer, 0.05, material=material)
    assert not any(estimate.converged for estimate in estimates)
    assert estimates[-1].on_map == pytest.approx(0.03), "as improbable as it can be"


@pytest.fixture(scope="module")
def faint() -> Localizer:
    """On a scan whose noise is as large as its signal."""
    scan, rng = strip_scan(sweeps=3), np.random.default_rng(7)
    noisy = dataclasses.replace(
        scan, strain=scan.strain + 3.0 * NOISE_V * rng.standard_normal(scan.strain.shape)
    )
    return build_localizer(noisy, SCENE, CONFIGURATION, np.random.default_rng(0))


@pytest.mark.parametrize("material", [None, 2, 3])
def test_nothing_that_has_the_maps_mean_strain_converges_on_a_faint_map(
    faint: Localizer, material: int | None
) -> None:
    """Smooth material, or another one: a belief that follows each strain fits it somewhere."""
    noise = 3.0 * NOISE_V * np.random.default_rng(8).standard_normal((200, 16))
    for start in (0.02, 0.1, 0.19):
        faint.reset()
        change = (
            noise if material else noise - strain(start + np.arange(200) * STEP, 1, np.random.default_rng(5))
        )
        _, estimates = slide(faint, start, material=material or 1, change=change)
        assert not any(estimate.converged for estimate in estimates)


def test_a_hand_that_was_put_down_elsewhere_is_found_again(localizer: Localizer) -> None:
    slide(localizer, 0.02, 0.05)
    x = 0.2 + np.arange(0.0, 0.05, STEP)
    felt = strain(x, 1, np.random.default_rng(6))
    for i, row in enumerate(felt):
        estimate = localizer.update(10**10 + 10_000_000 * i, np.array([0.75 + i * STEP]), row)
    assert estimate.converged
    assert abs(float(estimate.mean[0]) - x[-1]) < 0.002


def test_the_unit_of_the_strain_does_not_matter(localizer: Localizer) -> None:
    errors, estimates = slide(localizer, 0.1)
    scaled = build_localizer(strip_scan(volts=1e3), SCENE, CONFIGURATION, np.random.default_rng(0))
    scaled_errors, scaled_estimates = slide(scaled, 0.1, volts=1e3)
    np.testing.assert_allclose(scaled_errors, errors, atol=1e-4)
    assert [e.converged for e in scaled_estimates] == [e.converged for e in estimates]


def test_a_stuck_phalanx_is_left_out_and_does_not_mislead(localizer: Localizer) -> None:
    x = 0.1 + np.arange(0.0, 0.1, STEP)
    felt = strain(x, 1, np.random.default_rng(8))
    felt[:, 8:] = felt[0, 8:]
    for i, row in enumerate(felt):
        estimate = localizer.update(10_000_000 * i, np.array([i * STEP]), row)
    assert estimate.consistent.tolist() == [True, False]
    assert abs(float(estimate.mean[0]) - x[-1]) < 0.002


def test_an_absent_phalanx_is_tolerated(localizer: Localizer) -> None:
    x = 0.1 + np.arange(0.0, 0.1, STEP)
    felt = strain(x, 1, np.random.default_rng(9))
    felt[:, :8] = np.nan
    present = np.array([False, True])
    for i, row in enumerate(felt):
        estimate = localizer.update(10_000_000 * i, np.array([i * STEP]), row, present)
    assert abs(float(estimate.mean[0]) - x[-1]) < 0.002


@pytest.mark.parametrize("volts", [1e-9, 1e9])
@pytest.mark.parametrize("sweeps", [1, 3])
def test_extreme_scans_give_finite_estimates(sweeps: int, volts: float) -> None:
    scan = strip_scan(sweeps=sweeps, volts=volts)
    scan.strain[:, 3] = scan.strain[0, 3]  # a channel that never changes
    localizer = build_localizer(scan, SCENE, CONFIGURATION, np.random.default_rng(0))
    errors, estimates = slide(localizer, 0.05, 0.05, volts=volts)
    assert np.isfinite(errors).all()
    assert np.isfinite(estimates[-1].covariance).all()


def test_strains_unlike_every_other_leave_finite_numbers(localizer: Localizer) -> None:
    far = 1e6 * np.random.default_rng(10).standard_normal((40, 16))
    errors, estimates = slide(localizer, 0.05, 0.02, change=far)
    assert np.isfinite(errors).all()
    assert not estimates[-1].converged
