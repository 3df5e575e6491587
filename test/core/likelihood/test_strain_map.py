"""Tables of the expected strain and its variance."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.models import whitened_scan
from support.scans import raster, slides

from tactile_localizer.channels import ChannelLayout
from tactile_localizer.core.geometry.lattice import flatten_axes
from tactile_localizer.core.geometry.motion import YAW_LEVER
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.likelihood.noise_model import Visits, whiten
from tactile_localizer.core.likelihood.strain_map import (
    MOST_CELLS_IN_SPACE,
    StrainMap,
    VarianceModel,
    build_maps,
    cell_size,
    fit_variance,
)
from tactile_localizer.core.scan.interpolation import Expectation
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.core.scan.tracks import PITCH
from tactile_localizer.scene import Axis, Phalanx, Scene

SIDE, SPACING = 0.03, 0.003
PLANE = Scene("plane", (Axis("x", 0.0, SIDE), Axis("y", 0.0, SIDE)), (Phalanx("index", (0.0, 0.0), 3),))
LINE = Scene("line", (Axis("x", 0.0, 0.3),), (Phalanx("index", (0.0,), 3),))


SLOPE = np.array([[100.0, 20.0, -50.0], [30.0, -80.0, 10.0]])
SCAN = whitened_scan(raster(PLANE, lambda states, _: states @ SLOPE, SPACING), PLANE)


def repeats(correlation: float, seed: int = 0) -> Scan:
    """Three slides over waves, with noise of the given correlation length, m."""
    rng = np.random.default_rng(seed)
    x = np.arange(0.0, 0.3, PITCH)
    keep = np.exp(-PITCH / correlation)
    strain = []
    for _ in range(3):
        noise = rng.standard_normal((len(x), 3))
        for t in range(1, len(x)):
            noise[t] = keep * noise[t - 1] + np.sqrt(1.0 - keep**2) * noise[t]
        strain.append(8.0 * np.sin(x[:, None] * [400.0, 600.0, 900.0]) + noise)
    return slides(LINE, x, strain)


def of_all(cell: np.ndarray) -> StrainMap:
    """Tables of the scan, for cells (d,)."""
    (table,) = build_maps(SCAN, VarianceModel(), PLANE, cell, [np.zeros(len(SCAN.tracks), dtype=bool)])
    return table


def test_tables_hold_the_expectation_at_the_nodes() -> None:
    """Of strains that are linear in the place, whose mean is exact between any two lines."""
    table = of_all(np.array([0.001, 0.002]))
    axes = [o + s * np.arange(n) for o, s, n in zip(table.origin, table.step, table.shape, strict=True)]
    nodes = flatten_axes(axes)
    inner = ((nodes > SPACING) & (nodes < SIDE - SPACING)).all(axis=1)
    mean = np.broadcast_to((nodes[inner] @ SLOPE)[:, None], table.mean[inner].shape)
    np.testing.assert_allclose(table.mean[inner], mean, atol=1e-3)
    np.testing.assert_allclose(np.exp(table.log_prior).sum(axis=1), 1.0, rtol=1e-5)
    np.testing.assert_array_equal(table.nearest(nodes), np.arange(len(nodes)))
    assert table.mean.dtype == table.variance.dtype == np.float32


@given(st.lists(st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)), min_size=1, max_size=20))
def test_every_state_has_a_nearest_node(states: list[tuple[float, float]]) -> None:
    table = of_all(np.full(2, 0.005))
    index = table.nearest(np.array(states))
    node = table.origin + table.step * np.stack(np.unravel_index(index, table.shape), axis=1)
    inside = np.clip(states, PLANE.lower, PLANE.upper)
    assert (np.abs(node - inside) <= 0.5 * table.step + 1e-9).all()


def test_cell_size_on_one_and_two_axes() -> None:
    np.testing.assert_allclose(cell_size(PLANE, SPACING, 0.3), 0.0009)
    np.testing.assert_allclose(cell_size(PLANE, 1e-6, 0.3), PITCH)
    np.testing.assert_allclose(cell_size(PLANE, 1e-6, 0.3, 2.0), 2.0 * PITCH)
    np.testing.assert_allclose(cell_size(LINE, 0.0, 0.3), PITCH / 4)


def test_cells_on_three_axes_are_limited_in_number() -> None:
    axes = (Axis("x", 0.0, 0.05), Axis("y", 0.0, 0.05), Axis("yaw", -0.17, 0.17))
    space = Scene("space", axes, (Phalanx("index", (0.0, 0.0, 0.0)),))
    fine, coarse = cell_size(space, 0.0017, 0.3), cell_size(space, 0.005, 0.3)
    assert np.prod((space.upper - space.lower) / fine) == pytest.approx(MOST_CELLS_IN_SPACE)
    np.testing.assert_allclose(fine / fine[0], [1.0, 1.0, 1.0 / YAW_LEVER])
    np.testing.assert_allclose(coarse, [0.0015, 0.0015, 0.0015 / YAW_LEVER])


def test_the_variance_of_white_noise_is_one() -> None:
    scan = repeats(correlation=1e-9)
    fitted = fit_variance(whiten(Visits.of(scan, LINE), Material.CLOTH))
    assert fitted.visit == pytest.approx(1.0, rel=0.25)
    assert fitted.signal == 0.0, "the material has no zero to measure a signal from"


def test_on_cloth_the_noise_of_a_visit_explains_what_differs_with_the_signal() -> None:
    """There is no level from which a signal would deviate; on a sheet its own factors explain it."""
    rng, x = np.random.default_rng(1), np.arange(0.0, 0.3, PITCH)
    waves, visits = 8.0 * np.sin(x[:, None] * [400.0, 600.0, 900.0]), []
    for _ in range(3):
        visits.append(waves * (1.0 + 0.3 * rng.standard_normal((len(x), 1))))
    scan = whitened_scan(slides(LINE, x, visits), LINE)
    sheet, cloth = (fit_variance(scan._replace(material=each)) for each in Material)
    assert cloth.signal == cloth.gain == 0.0
    assert cloth.visit == pytest.approx(1.7, rel=0.15)
    assert sheet.visit < 0.2
    assert sheet.gain > 0.1


def test_a_single_sweep_has_the_default_variance() -> None:
    scan = repeats(1e-9)
    single = Visits.of(scan.select(scan.sweep == 0), LINE)
    assert fit_variance(whiten(single, Material.CLOTH)) == VarianceModel()


def test_where_both_lines_are_featureless_the_map_has_no_noise() -> None:
    """Otherwise places between lines would be preferred on featureless material."""
    mean, error = np.array([[[0.0, 0.0, 2.0]]]), np.zeros((1, 1, 3))
    expected = Expectation(mean, error, np.array([[0.5]]), np.zeros((1, 1)), np.zeros(1))
    found = VarianceModel(2.0, 0.0, 0.0).variance(expected, ChannelLayout((2, 1)))
    np.testing.assert_allclose(found, [[[2.0, 2.0 * 1.5]]])
