"""Extremes that must be right, for the sweep mixture from a scan to an estimate."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_localizer.core.calibration.held_out import Calibration
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.core.localizer import Localizer
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import MeasurementError
from tactile_localizer.scene import Axis, Phalanx, Scene

LENGTH, STEP = 0.1, 0.0005
LINE = Scene("line", (Axis("x", 0.0, LENGTH),), (Phalanx("index", (0.0,), 4), Phalanx("thumb", (0.0,), 4)))
X = np.arange(0.0, LENGTH, STEP)


def felt(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Strains (n, 8) of a few volts with noise of 50 mV."""
    return np.sin(x[:, None] * np.linspace(200.0, 900.0, 8) + np.arange(8.0)) + 0.05 * rng.standard_normal(
        (len(x), 8)
    )


def scan(sweeps: int = 3, volts: float = 1.0) -> Scan:
    rng = np.random.default_rng(0)
    strain = volts * np.concatenate([felt(X, rng) for _ in range(sweeps)])
    sweep = np.repeat(np.arange(sweeps), len(X))
    return Scan(np.tile(X, sweeps)[:, None], strain, sweep, ("x",), ("index", "thumb"), (4, 4))


def built(made: Scan, kind: str = "grid", scene: Scene = LINE) -> Localizer:
    calibration = Calibration(0.005, np.full(scene.dimension, 1e-4))
    return build_localizer(
        made, scene, Configuration(filter=kind), np.random.default_rng(0), calibration=calibration
    )


def slide(localizer: Localizer, volts: float = 1.0, **change: np.ndarray) -> list[float]:
    """Errors, m, along 40 mm from 30 mm on."""
    x = np.arange(0.03, 0.07, STEP)
    strain = volts * felt(x, np.random.default_rng(1)) + change.get("added", 0.0)
    estimates = [
        localizer.update(10_000_000 * n, np.array([place]), row)
        for n, (place, row) in enumerate(zip(x, strain, strict=True))
    ]
    assert all(np.isfinite(e.covariance).all() and 0.0 <= e.probability <= 1.0 for e in estimates)
    return [abs(float(e.mean[0]) - place) for e, place in zip(estimates, x, strict=True)]


@pytest.mark.parametrize("kind", ["grid", "particle"])
@pytest.mark.parametrize("volts", [1e-9, 1.0, 1e9])
def test_strains_of_a_nanovolt_and_a_gigavolt_are_only_another_unit(volts: float, kind: str) -> None:
    assert slide(built(scan(volts=volts), kind), volts)[-1] < 0.001


@pytest.mark.parametrize("sweeps", [1, 2])
def test_fewer_sweeps_than_channels_are_enough(sweeps: int) -> None:
    assert slide(built(scan(sweeps)))[-1] < 0.001


def test_a_scan_of_one_pair_gives_finite_estimates() -> None:
    slide(built(scan().select(np.array([50]))))


def test_duplicate_pairs_change_nothing() -> None:
    made = scan()
    twice = made.select(np.repeat(np.arange(len(made)), 2))
    np.testing.assert_allclose(slide(built(twice)), slide(built(made)), atol=1e-9)


def test_a_channel_that_never_changes_does_not_matter() -> None:
    made = scan()
    made.strain[:, 2] = 0.7
    localizer, x = built(made), np.arange(0.03, 0.07, STEP)
    strain = felt(x, np.random.default_rng(1))
    strain[:, 2] = 0.7
    for n, (place, row) in enumerate(zip(x, strain, strict=True)):
        estimate = localizer.update(10_000_000 * n, np.array([place]), row)
    assert abs(float(estimate.mean[0]) - x[-1]) < 0.001


@pytest.mark.parametrize("kind", ["grid", "particle"])
def test_strains_a_million_sigma_from_the_map_converge_nowhere(kind: str) -> None:
    localizer = built(scan(), kind)
    slide(localizer, added=5e4 * np.random.default_rng(2).standard_normal((81, 8)))
    assert not localizer.update(10**12, np.zeros(1), np.zeros(8)).converged


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
def test_what_is_not_finite_is_refused_and_the_belief_untouched(bad: float) -> None:
    localizer = built(scan())
    slide(localizer)
    before = localizer.hypotheses()[1].copy()
    with pytest.raises(MeasurementError):
        localizer.update(10**12, np.zeros(1), np.full(8, bad))
    with pytest.raises(MeasurementError):
        localizer.update(10**12, np.array([bad]), np.zeros(8))
    np.testing.assert_array_equal(localizer.hypotheses()[1], before)


def test_a_hand_beyond_the_bounds_is_elsewhere() -> None:
    localizer = built(scan())
    slide(localizer)
    estimate = localizer.update(10**12, np.array([0.5]), np.zeros(8))
    assert not estimate.converged
    assert estimate.on_map < 0.9


def test_yaw_wraps_around() -> None:
    scene = Scene("knob", (Axis("yaw", -np.pi, np.pi),), (Phalanx("index", (0.0,), 4),))
    yaw, rng = np.arange(-np.pi, np.pi, 0.02), np.random.default_rng(0)

    def strain(at: np.ndarray) -> np.ndarray:
        waves = np.arange(1.0, 5.0)
        return np.sin(at[:, None] * waves + waves) + 0.02 * rng.standard_normal((len(at), 4))

    made = Scan(
        np.tile(yaw, 3)[:, None],
        np.concatenate([strain(yaw) for _ in range(3)]),
        np.repeat(np.arange(3), len(yaw)),
        ("yaw",),
        ("index",),
        (4,),
    )
    localizer = built(made, scene=scene)
    turned = np.pi - 0.5 + np.arange(0.0, 1.0, 0.02)
    for n, (place, row) in enumerate(zip(turned, strain(turned), strict=True)):
        estimate = localizer.update(10_000_000 * n, np.array([(place + np.pi) % (2 * np.pi) - np.pi]), row)
    off = (float(estimate.mean[0]) - turned[-1] + np.pi) % (2.0 * np.pi) - np.pi
    assert abs(off) < 0.05


@pytest.fixture(scope="module")
def localizer() -> Localizer:
    return built(scan())


@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1))
def test_whatever_is_felt_the_estimate_is_a_distribution(localizer: Localizer, seed: int) -> None:
    rng = np.random.default_rng(seed)
    localizer.reset()
    for n in range(20):
        size = 10.0 ** rng.uniform(-6.0, 6.0)
        present = rng.random(2) < 0.8
        present[rng.integers(2)] = True
        place = rng.uniform(-0.01, 0.01, 1)
        estimate = localizer.update(10_000_000 * n, place, size * rng.standard_normal(8), present)
        assert np.isfinite(estimate.mean).all()
        assert np.linalg.eigvalsh(estimate.covariance).min() > 0.0
        assert localizer.hypotheses()[1].sum() == pytest.approx(1.0)
        assert 0.0 <= estimate.probability <= estimate.on_map + 1e-12 <= 1.0 + 1e-12


@pytest.mark.parametrize("volts", [1e15, 1e30, 1e90])
def test_one_absurd_strain_does_not_end_a_localization(volts: float) -> None:
    localizer = built(scan())
    localizer.update(0, np.array([0.03]), np.full(8, volts))
    assert slide(localizer)[-1] < 0.001
