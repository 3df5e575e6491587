"""From a scan of a material felt everywhere to a converged position, on waves known in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.learned import learn_once
from support.scans import slides

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.calibration.sweep_model import learn_sweep_model
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.localizer import Estimate, Localizer
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Axis, Phalanx, Scene

LENGTH, STEP, NOISE_V = 0.3, 0.0005, 0.05
SCENE = Scene("cloth", (Axis("x", 0.0, LENGTH),), (Phalanx("index", (0.0,)), Phalanx("middle", (0.0,))))
X = np.arange(0.0, LENGTH, STEP)


def strain(x: np.ndarray, material: int, seed: int) -> np.ndarray:
    """Waves with wavelengths of 5 to 40 mm that differ between materials, with noise, (n, 16) V."""
    waves = np.random.default_rng(material)
    frequency, phase = waves.uniform(150.0, 1200.0, (16, 4)), waves.uniform(0.0, 6.28, (16, 4))
    clean = 0.1 * np.sin(x[:, None, None] * frequency + phase).sum(axis=2)
    return np.asarray(clean + NOISE_V * np.random.default_rng(seed).standard_normal(clean.shape))


def cloth_scan(sweeps: int = 3, noise: float = 0.0) -> Scan:
    rng = np.random.default_rng(7)
    felt = [strain(X, 1, 10 + sweep) + noise * rng.standard_normal((len(X), 16)) for sweep in range(sweeps)]
    return slides(SCENE, X, felt)


def build(
    scan: Scan, kind: str = "grid", scene: Scene = SCENE, known: Calibration | None = None
) -> Localizer:
    configuration, rng = Configuration(filter=kind), np.random.default_rng(0)
    return build_localizer(scan, scene, configuration, rng, calibration=known or learn_once(scan, scene))


@pytest.fixture(scope="module", params=["grid", "particle"])
def built(request: pytest.FixtureRequest) -> Localizer:
    return build(cloth_scan(), request.param)


@pytest.fixture
def localizer(built: Localizer) -> Localizer:
    built.reset()
    return built


def fed(
    localizer: Localizer, felt: np.ndarray, first_ns: int = 0, present: np.ndarray | None = None
) -> list[Estimate]:
    """Estimates along a sweep from anywhere in the arm's frame."""
    return [
        localizer.update(first_ns + 10_000_000 * n, np.array([0.7 + n * STEP]), row, present)
        for n, row in enumerate(felt)
    ]


def off(estimates: list[Estimate], start: float) -> np.ndarray:
    """Errors (n,), m, of estimates along a sweep from ``start``."""
    return np.array([abs(float(e.mean[0]) - start - n * STEP) for n, e in enumerate(estimates)])


def way(start: float, travel: float = 0.1) -> np.ndarray:
    return start + np.arange(0.0, travel, STEP)


def assert_found(localizer: Localizer, felt: np.ndarray, start: float) -> None:
    """At the end, and never converged at another place."""
    estimates = fed(localizer, felt)
    errors = off(estimates, start)
    assert estimates[-1].converged, estimates[-1].reason
    assert errors[-1] < 0.001
    assert not any(e.converged and error > 0.005 for e, error in zip(estimates, errors, strict=True))


@pytest.mark.parametrize("start", [0.01, 0.08, 0.17])
def test_a_sweep_from_an_unknown_start_converges_to_its_place(localizer: Localizer, start: float) -> None:
    assert_found(localizer, strain(way(start), 1, 5), start)


SIGNS = np.random.default_rng(3).choice([-1.0, 1.0], 16)
RAMP = np.outer(way(0.0) / 0.1, SIGNS)
NOISY = 20.0 * np.random.default_rng(4).standard_normal(len(RAMP))[:, None] * np.eye(16)[5]


@pytest.mark.parametrize("gain", [0.75, 1.0, 1.3])
@pytest.mark.parametrize(
    "change",
    [3.0 * SIGNS, 30.0 * SIGNS, 3.0 * RAMP, 10.0 * RAMP, NOISY],
    ids=["offset", "large offset", "drift", "strong drift", "a noisy channel"],
)
def test_a_sweep_of_another_session_converges_to_its_place(
    localizer: Localizer, change: np.ndarray, gain: float
) -> None:
    """Another squeezing force and, in noise widths, another tare or a drift per 100 mm."""
    assert_found(localizer, gain * strain(way(0.1), 1, 5) + NOISE_V * change, 0.1)


def test_a_phalanx_that_is_silent_drops_out_although_its_noise_is_whitened_with_the_others(
    localizer: Localizer,
) -> None:
    """Stuck from the beginning or from the middle on: the other one finds the place."""
    felt, middle = strain(way(0.1), 1, 5), np.arange(200) >= 100
    for silent in (np.ones(200, dtype=bool), middle):
        stuck = np.where(silent[:, None] & (np.arange(16) >= 8), 0.37, felt)
        localizer.reset()
        assert_found(localizer, stuck, 0.1)


@pytest.mark.parametrize("material", [2, 3, 4])
@pytest.mark.parametrize(("gain", "offset"), [(1.0, 0.0), (1.0, 30.0), (0.3, 30.0)])
def test_another_material_never_converges(
    localizer: Localizer, material: int, gain: float, offset: float
) -> None:
    estimates = fed(localizer, gain * strain(way(0.05), material, 5) + offset * NOISE_V)
    assert not any(estimate.converged for estimate in estimates)
    assert estimates[-1].on_map < 0.1


@pytest.mark.parametrize("material", [None, 2, 3])
def test_on_a_faint_map_neither_smooth_nor_other_material_converges(material: int | None) -> None:
    """The noise is as large as the signal: a belief that follows each strain fits it somewhere."""
    faint = build(cloth_scan(noise=3.0 * NOISE_V))
    for start in (0.02, 0.1, 0.19):
        faint.reset()
        felt = strain(way(start), material or 1, 5)
        noise = 3.0 * NOISE_V * np.random.default_rng(8).standard_normal(felt.shape)
        assert not any(e.converged for e in fed(faint, noise + (felt if material else felt.mean(axis=0))))


def test_strains_a_million_widths_from_the_map_converge_nowhere(localizer: Localizer) -> None:
    far = 1e6 * NOISE_V * np.random.default_rng(10).standard_normal((80, 16))
    estimates = fed(localizer, strain(way(0.05, 0.04), 1, 5) + far)
    assert np.isfinite(estimates[-1].covariance).all()
    assert not any(estimate.converged for estimate in estimates)


def test_yaw_wraps_around() -> None:
    scene = Scene("knob", (Axis("yaw", -np.pi, np.pi),), (Phalanx("index", (0.0,), 4),))
    yaw, rng, waves = np.arange(-np.pi, np.pi, 0.02), np.random.default_rng(0), np.arange(1.0, 5.0)

    def turned(at: np.ndarray) -> np.ndarray:
        return np.sin(at[:, None] * waves + waves) + 0.02 * rng.standard_normal((len(at), 4))

    scan, known = slides(scene, yaw, [turned(yaw) for _ in range(3)]), Calibration(np.array([0.01]))
    localizer = build(scan, scene=scene, known=known)
    way = np.pi - 0.5 + np.arange(0.0, 1.0, 0.02)
    for n, (place, row) in enumerate(zip(way, turned(way), strict=True)):
        estimate = localizer.update(10_000_000 * n, np.array([(place + np.pi) % (2 * np.pi) - np.pi]), row)
    assert (float(estimate.mean[0]) - way[-1] + np.pi) % (2.0 * np.pi) - np.pi == pytest.approx(0.0, abs=0.05)


def with_common_noise(scene: Scene = SCENE) -> Localizer:
    """On a scan in which most of the noise is common to both phalanges, with lengths of the usual one."""
    scan = cloth_scan()
    common = 0.1 * np.random.default_rng(3).standard_normal((len(scan.strain), 8))
    noisy = replace(scan, strain=scan.strain + np.tile(common, 2))
    return build(noisy, scene=scene, known=learn_once(scan, SCENE)._replace(variance=None))


def test_of_an_absent_phalanx_nothing_counts() -> None:
    felt, localizer, ends = strain(way(0.1), 1, 5), with_common_noise(), []
    for volts in (0.0, 1e6):
        localizer.reset()
        felt[:, 8:] = volts
        ends.append(fed(localizer, felt, present=np.array([True, False]))[-1])
    np.testing.assert_array_equal(ends[0].mean, ends[1].mean)
    assert ends[0].converged, ends[0].reason
    assert float(ends[0].mean[0]) == pytest.approx(0.1 + 199 * STEP, abs=0.001)


def test_with_an_absent_phalanx_the_noise_is_that_of_the_other_one_alone() -> None:
    """It is whitened given the first, without which there is more of it."""
    felt = strain(way(0.1), 1, 5)
    felt += 0.1 * np.tile(np.random.default_rng(4).standard_normal((len(felt), 8)), 2)
    of_one = Scene("one", SCENE.axes, SCENE.phalanges[1:])
    alone = fed(with_common_noise(of_one), felt[:, 8:])
    beside = fed(with_common_noise(), felt, present=np.array([False, True]))
    one, other = (np.mean([each.log_marginal for each in ends[100:]]) for ends in (alone, beside))
    assert other == pytest.approx(one, abs=0.5)


def test_a_slow_wave_of_the_map_is_not_expected_of_other_material() -> None:
    """It is in no innovation."""
    plain, found = cloth_scan(), []
    for scan in (plain, replace(plain, strain=plain.strain + 5.0 * plain.states)):
        learned = learn_sweep_model(scan, SCENE, Material.CLOTH)
        other = learned.mixture(SCENE, learned.cell(SCENE, 1.0)).other
        log_likelihood, _ = other.update(
            other.start(), np.full(16, 3.0), np.zeros(2), np.ones(2, bool), 0.0005, 1.0
        )
        found.append(log_likelihood)
    assert found[1] == pytest.approx(found[0], abs=0.5)


@pytest.mark.parametrize("volts", [1e2, 1e4, 1e15, 1e90])
@pytest.mark.parametrize("at", [0, 100])
def test_one_absurd_strain_does_not_end_a_localization(localizer: Localizer, volts: float, at: int) -> None:
    felt = strain(way(0.1), 1, 5)
    felt[at] = volts
    assert off(fed(localizer, felt), 0.1)[-1] < 0.001


def test_one_sweep_is_enough() -> None:
    assert_found(build(cloth_scan(1)), strain(way(0.1), 1, 5), 0.1)


def test_a_scan_of_one_pair_gives_finite_estimates() -> None:
    estimates = fed(build(cloth_scan().select(np.array([50]))), strain(way(0.1), 1, 5))
    assert all(np.isfinite(estimate.covariance).all() for estimate in estimates)
