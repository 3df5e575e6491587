"""Features are told apart by what sweeps side by side agree on."""

import numpy as np
import pytest

from tactile_localizer.core.naming import Namer, disagreement
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Axis, Phalanx, Scene

SCENE = Scene(
    "strip",
    (Axis("x", 0.0, 0.05), Axis("y", 0.0, 0.02)),
    (Phalanx("a", (0.0, 0.0)), Phalanx("b", (0.0, 0.0))),
)
POSITION_STD = np.array([0.003, 0.003])
BOTH = np.ones(2, dtype=bool)
LOOSE, FIRM = np.zeros(16), np.zeros(16)
LOOSE[[0, 1, 8, 9]] = 0.5  # of grip: both phalanges, alike
FIRM[[0, 8]], FIRM[[1, 9]] = 0.05, -0.05


def sweeps(sign: float, seed: int) -> Scan:
    """Sweeps that differ much along LOOSE and hardly in anything else; ``sign`` is what the feature is."""
    rng = np.random.default_rng(seed)
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(0, 0.05, 60), np.linspace(0, 0.02, 9)))
    sweep = np.repeat(np.arange(9), 60)
    profile = np.sin(np.pi * x / 0.05)[:, None]
    strain = profile * (sign * FIRM + rng.standard_normal((9, 1))[sweep] * LOOSE)
    return Scan(
        np.column_stack([x, y]), strain + 0.01 * rng.standard_normal((540, 16)), sweep, ("x", "y"), ("a", "b")
    )


@pytest.fixture(scope="module")
def namers() -> tuple[Namer, Namer]:
    scans = sweeps(1.0, 1), sweeps(-1.0, 2)
    covariance = disagreement((scan, SCENE) for scan in scans)
    first, second = (Namer(scan, SCENE, POSITION_STD, covariance) for scan in scans)
    return first, second


def named(namers: tuple[Namer, Namer], present: np.ndarray) -> list[bool]:
    """For the middle of each new sweep of the first feature, whether that one explains it better."""
    new, at = sweeps(1.0, 3), np.array([[0.025, 0.01]])
    belief = np.repeat(at, 50, axis=0) + np.random.default_rng(4).normal(0.0, 0.002, (50, 2))
    weights = np.full(50, 0.02)
    rows = np.flatnonzero(np.abs(new.states[:, 0] - 0.025) < 0.0008)
    first, second = (
        [namer.log_density(belief, weights, new.strain[row], present) for row in rows] for namer in namers
    )
    return [a > b for a, b in zip(first, second, strict=True)]


def test_a_feature_is_known_by_what_hardly_differs_from_sweep_to_sweep(namers: tuple[Namer, Namer]) -> None:
    assert np.mean(named(namers, BOTH)) > 0.9


@pytest.mark.parametrize("index", [0, 1])
def test_it_is_known_by_one_phalanx_alone(namers: tuple[Namer, Namer], index: int) -> None:
    assert np.mean(named(namers, np.arange(2) == index)) > 0.8


def test_the_disagreement_is_large_along_what_differs_from_sweep_to_sweep() -> None:
    covariance = disagreement([(sweeps(1.0, 1), SCENE)])
    grip = LOOSE / np.linalg.norm(LOOSE)
    tells = FIRM / np.linalg.norm(FIRM)
    assert grip @ covariance @ grip > 10 * (tells @ covariance @ tells)
    assert np.linalg.eigvalsh(covariance).min() > 0


def test_sweeps_that_agree_to_the_last_digit_still_have_a_width() -> None:
    scan = sweeps(1.0, 1)
    alike = Scan(scan.states, np.zeros_like(scan.strain), scan.sweep, scan.axes, scan.phalanges)
    assert np.linalg.eigvalsh(disagreement([(alike, SCENE)])).min() > 0
