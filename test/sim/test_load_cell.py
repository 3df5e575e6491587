"""Conversion of wrenches to strain."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactile_localizer.sim.load_cell import DRIFT_V, drift, load_cell

WRENCH = arrays(float, (1, 6), elements=st.floats(-5, 5))


def test_the_gain_has_full_rank():
    scaled = load_cell(101).gain / [1, 1, 1, 100, 100, 100]  # V per N and V per 10 N mm
    singular = np.linalg.svd(scaled, compute_uv=False)
    assert singular[-1] > 0.02 * singular[0]


@given(WRENCH, WRENCH, st.floats(-2, 2))
def test_strain_is_affine_in_the_wrench(a, b, share):
    cell = load_cell(101)
    mixed = cell.strain(a + share * (b - a))
    np.testing.assert_allclose(
        mixed, cell.strain(a) + share * (cell.strain(b) - cell.strain(a)), atol=1e-9 * 1e4
    )


def test_an_unloaded_cell_reads_its_bias():
    cell = load_cell(101)
    np.testing.assert_array_equal(cell.strain(np.zeros((1, 6)))[0], cell.bias)


def test_serial_numbers_identify_cells():
    np.testing.assert_array_equal(load_cell(7).gain, load_cell(7).gain)
    assert np.max(np.abs(load_cell(7).gain - load_cell(8).gain)) > 0.01


def test_gauges_respond_differently():
    rows = load_cell(101).gain / [1, 1, 1, 100, 100, 100]
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    alike = np.abs(rows @ rows.T) - np.eye(8)
    assert np.max(alike) < 0.99


def test_drift_is_slow_and_small():
    time_s = np.arange(0, 3600, 1.0)
    course = drift(np.random.default_rng(1), time_s, 200)
    assert 0.7 * DRIFT_V < np.std(course) < 1.4 * DRIFT_V
    assert np.max(np.abs(np.diff(course, axis=0))) < 0.5e-3
