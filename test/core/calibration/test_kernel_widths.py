"""Kernel widths, by the density of held-out strains."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_localizer.core.calibration.kernel_widths import (
    STRAIN_FACTORS,
    choose_kernel_widths,
    describe_unfit_widths,
    held_out_log_densities,
)
from tactile_localizer.core.likelihood.base import MeasurementModel
from tactile_localizer.core.likelihood.sum_of_gaussians import SumOfGaussians
from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.spacing import base_widths
from tactile_localizer.scene import Axis, Phalanx, Scene

pytestmark = pytest.mark.slow

SCENE = Scene("line", (Axis("x", 0.0, 0.06, 0.002),), (Phalanx("index", (0.0,)),))


def lines(noise: float = 0.05, sweeps: int = 4, pairs: int = 240) -> Scan:
    """Sweeps along one axis over a smooth random pattern of 1 V, with the same noise in each."""
    rng = np.random.default_rng(0)
    x = np.tile(np.linspace(0.0, 0.06, pairs), sweeps)
    phases, waves = rng.uniform(0, 6, 8), rng.uniform(200, 500, 8)
    strain = np.sin(x[:, None] * waves + phases) + noise * rng.standard_normal((len(x), 8))
    return Scan(x[:, None], strain, np.repeat(np.arange(sweeps), pairs), ("x",), ("index",))


def test_noisier_scans_get_wider_strain_kernels() -> None:
    quiet, noisy = (choose_kernel_widths(lines(n), SCENE, ModelParameters()).strain_std for n in (0.05, 0.3))
    assert np.mean(noisy) > 2.0 * np.mean(quiet)


def test_given_widths_are_kept() -> None:
    chosen = choose_kernel_widths(lines(), SCENE, ModelParameters(position_std=0.001, neighbours=12))
    assert (chosen.position_std, chosen.neighbours) == (0.001, 12)
    assert chosen.strain_std is not None


def test_of_equal_widths_the_widest_are_chosen() -> None:
    """With two pairs all widths are equally good."""
    scan = lines().select(np.array([0, 240]))
    chosen = choose_kernel_widths(scan, SCENE, ModelParameters())
    assert np.isfinite(chosen.position_std).all()
    assert (chosen.strain_std <= max(STRAIN_FACTORS) * base_widths(scan, SCENE)[1] * (1 + 1e-9)).all()


def test_strains_are_held_out_with_their_sweep() -> None:
    scan = lines()
    seen: list[set[int]] = []

    def build(rest: Scan) -> MeasurementModel:
        seen.append(set(rest.sweep_numbers.tolist()))
        return SumOfGaussians(rest, SCENE, 0.001, 0.05)

    density = held_out_log_densities(scan, SCENE, np.arange(len(scan)), build)
    assert [({0, 1, 2, 3} - sweeps).pop() for sweeps in seen] == [0, 1, 2, 3]
    assert density.shape == (4 * 60,)
    assert np.isfinite(density).all()


@pytest.mark.parametrize("volts", [1e-9, 1e9])
def test_the_unit_of_the_strain_does_not_matter(volts: float) -> None:
    scan = lines()
    scaled = Scan(scan.states, volts * scan.strain, scan.sweep, scan.axes, scan.phalanges)
    one, other = (choose_kernel_widths(s, SCENE, ModelParameters()) for s in (scan, scaled))
    np.testing.assert_allclose(other.strain_std, volts * np.asarray(one.strain_std), rtol=1e-6)
    np.testing.assert_allclose(other.position_std, one.position_std)


@pytest.mark.parametrize("widths", [{}, {"position_std": 0.001}, {"strain_std": 0.07}])
def test_fitting_widths_are_not_reported(widths: dict[str, float]) -> None:
    assert describe_unfit_widths(lines(pairs=120), replace(SCENE, measurement=widths)) is None


@pytest.mark.parametrize(
    "widths",
    [
        {"strain_std": 0.0007},
        {"strain_std": 5.0},
        {"position_std": 1.0},
        {"position_std": 0.02, "strain_std": 0.07},
    ],
)
def test_unfit_widths_are_named(widths: dict[str, float]) -> None:
    line = describe_unfit_widths(lines(pairs=120), replace(SCENE, measurement=widths))
    assert line is not None
    assert line.startswith("measurement of scene line: expected kernel widths that fit")
    assert all(f"{name} {value:.2g}" in line for name, value in widths.items())
