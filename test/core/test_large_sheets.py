"""A large sheet has cells only where it was scanned."""

import numpy as np
import pytest
from support.scans import raster

from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.calibration.examination import Examination
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer
from tactile_localizer.scene import Axis, Phalanx, Scene

KNOWN = Calibration(np.full(2, 5e-4), examination=Examination(0.0017, 0.0017))


@pytest.mark.parametrize(("length", "bound", "known"), [(1.0, 1.1, KNOWN), (0.06, 30.0, None)])
def test_a_large_sheet_has_cells_only_where_it_was_scanned(length, bound, known):
    """Of three lines on material that is felt everywhere."""
    rng = np.random.default_rng(0)
    waves, phases = rng.normal(0.0, 300.0, (2, 8, 6)), rng.uniform(0.0, 6.0, (8, 6))

    def strain(places: np.ndarray, _: np.ndarray | None = None) -> np.ndarray:
        clean = 0.02 * np.sin(np.tensordot(places, waves, 1) + phases).sum(axis=2)
        return clean + rng.normal(0.0, 0.002, clean.shape)

    def sheet(lower: float, x: float, y: float) -> Scene:
        axes = Axis("x", lower, x, 0.0035), Axis("y", lower, y, 0.002)
        return Scene("sheet", axes, (Phalanx("index", (0.0, 0.0)),))

    made = raster(sheet(0.0, length, 0.006), strain, first=0.0)
    localizer = build_localizer(made, sheet(-bound, bound, bound), Configuration(), rng, calibration=known)
    assert len(localizer.hypotheses()[0]) < 1e6 * (length + 0.1) * (0.005 + 0.1)
    start = np.array([0.2 * length, 0.0038])
    for index in range(min(100, round(700 * length))):
        place = start + np.array([0.001 * index, 0.0])
        estimate = localizer.update(10_000_000 * index, place, strain(place[None])[0])
    np.testing.assert_allclose(estimate.mean, place, atol=0.003)
