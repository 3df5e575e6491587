"""Kernel widths, from the distance between lines and the difference of their strains."""

import numpy as np
import pytest

from tactile_localizer.core.calibration.kernel_widths import choose_kernel_widths
from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Axis, Phalanx, Scene

SCENE = Scene("plane", (Axis("x", 0.0, 0.06), Axis("y", 0.0, 0.02)), (Phalanx("index", (0.0, 0.0)),))
SPACING = 0.004


def lines(noise: float = 0.05, volts: float = 1.0, pairs: int = 240) -> Scan:
    """Five lines along x over a smooth pattern of 1 V, with the same noise on each."""
    rng = np.random.default_rng(0)
    x, y = np.tile(np.linspace(0.0, 0.06, pairs), 5), np.repeat(SPACING * np.arange(5), pairs)
    strain = np.sin(x[:, None] * rng.uniform(200, 500, 8)) + noise * rng.standard_normal((len(x), 8))
    return Scan(np.stack([x, y], 1), volts * strain, np.repeat(np.arange(5), pairs), ("x", "y"), ("index",))


def test_widths_follow_the_distance_of_the_lines_and_the_noise() -> None:
    quiet, noisy = (choose_kernel_widths(lines(noise), SCENE, ModelParameters()) for noise in (0.05, 0.3))
    np.testing.assert_allclose(quiet.position_std, 0.8 * SPACING, rtol=0.01)
    assert np.mean(noisy.strain_std) == pytest.approx(6.0 * np.mean(quiet.strain_std), rel=0.1)


def test_given_widths_are_kept() -> None:
    chosen = choose_kernel_widths(lines(), SCENE, ModelParameters(position_std=0.001, neighbours=12))
    assert (chosen.position_std, chosen.neighbours) == (0.001, 12)
    assert chosen.strain_std is not None


@pytest.mark.parametrize("volts", [1e-9, 1e9])
def test_the_unit_of_the_strain_does_not_matter(volts: float) -> None:
    one, other = (choose_kernel_widths(lines(volts=v), SCENE, ModelParameters()) for v in (1.0, volts))
    np.testing.assert_allclose(other.strain_std, volts * np.asarray(one.strain_std), rtol=1e-6)


def test_channels_without_noise_have_a_positive_width() -> None:
    assert (choose_kernel_widths(lines(noise=0.0), SCENE, ModelParameters()).strain_std > 0).all()
