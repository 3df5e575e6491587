"""Kernel widths that a scene gives are held against the scan's own held-out strains."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_localizer.core.calibration.given_widths import describe_unfit_widths
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Axis, Phalanx, Scene

SCENE = Scene("line", (Axis("x", 0.0, 0.06, 0.002),), (Phalanx("index", (0.0,)),))


def lines() -> Scan:
    """Four sweeps along one axis over a smooth random pattern of 1 V, with noise of 0.05 V."""
    rng = np.random.default_rng(0)
    x = np.tile(np.linspace(0.0, 0.06, 120), 4)
    phases, waves = rng.uniform(0, 6, 8), rng.uniform(200, 500, 8)
    strain = np.sin(x[:, None] * waves + phases) + 0.05 * rng.standard_normal((len(x), 8))
    return Scan(x[:, None], strain, np.repeat(np.arange(4), 120), ("x",), ("index",))


@pytest.mark.parametrize("widths", [{}, {"position_std": 0.001}, {"strain_std": 0.07}])
def test_widths_that_fit_are_not_reported(widths: dict[str, float]) -> None:
    assert describe_unfit_widths(lines(), replace(SCENE, measurement=widths)) is None


@pytest.mark.parametrize(
    "widths",
    [
        {"strain_std": 0.0007},
        {"strain_std": 5.0},
        {"position_std": 1.0},
        {"position_std": 0.02, "strain_std": 0.07},
    ],
)
def test_widths_that_do_not_fit_are_named_in_one_line(widths: dict[str, float]) -> None:
    line = describe_unfit_widths(lines(), replace(SCENE, measurement=widths))
    assert line is not None
    assert line.startswith("measurement of scene line: expected kernel widths that fit")
    assert "\n" not in line
    assert all(f"{name} {value:.2g}" in line for name, value in widths.items())
