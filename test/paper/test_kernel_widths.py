"""Kernel widths, from the distance between lines and the difference of their strains."""

from typing import Any

import numpy as np
import pytest

from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.errors import ParameterError
from tactile_localizer.paper.kernel_widths import kernel_widths
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
    (position_std, quiet), (_, noisy) = (kernel_widths(lines(noise), SCENE) for noise in (0.05, 0.3))
    np.testing.assert_allclose(position_std, 0.8 * SPACING, rtol=0.01)
    assert np.mean(noisy) == pytest.approx(6.0 * np.mean(quiet), rel=0.1)


def test_given_widths_are_kept() -> None:
    position_std, strain_std = kernel_widths(lines(), SCENE, position_std=[0.001, 0.002])
    assert position_std.tolist() == [0.001, 0.002]
    np.testing.assert_array_equal(strain_std, kernel_widths(lines(), SCENE)[1])
    assert kernel_widths(lines(), SCENE, 0.001, 25e3)[1].tolist() == [25e3] * 8


@pytest.mark.parametrize(
    ("widths", "message"),
    [
        ({"position_std": "wide"}, "position_std: expected a finite number, got 'wide'"),
        ({"position_std": [1, 1, 1]}, "position_std: expected one number or 2, got"),
        ({"position_std": []}, "position_std: expected one number or 2, got"),
        ({"position_std": 1e300}, "position_std: expected 1e-12 to"),
        ({"strain_std": [[1]]}, "strain_std: expected one number or 8, got"),
        ({"strain_std": 0.0}, "strain_std: expected 1e-12 to"),
        ({"strain_std": float("nan")}, "strain_std: expected a finite number, got nan"),
    ],
)
def test_a_width_that_is_none_is_refused(widths: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        kernel_widths(lines(), SCENE, **widths)


@pytest.mark.parametrize("volts", [1e-9, 1e9])
def test_the_unit_of_the_strain_does_not_matter(volts: float) -> None:
    one, other = (kernel_widths(lines(volts=v), SCENE)[1] for v in (1.0, volts))
    np.testing.assert_allclose(other, volts * one, rtol=1e-6)


def test_channels_without_noise_have_a_positive_width() -> None:
    assert (kernel_widths(lines(noise=0.0), SCENE)[1] > 0).all()
