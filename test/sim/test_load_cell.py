"""Conversion of wrenches to strain."""

import numpy as np

from tactile_localizer.sim.load_cell import DRIFT_V, drift, load_cell


def test_the_gain_has_full_rank():
    scaled = load_cell(101).gain / [1, 1, 1, 100, 100, 100]  # V per N and V per 10 N mm
    singular = np.linalg.svd(scaled, compute_uv=False)
    assert singular[-1] > 0.02 * singular[0]


def test_drift_is_slow_and_small():
    time_s = np.arange(0, 3600, 1.0)
    course = drift(np.random.default_rng(1), time_s, 200)
    assert 0.7 * DRIFT_V < np.std(course) < 1.4 * DRIFT_V
    assert np.max(np.abs(np.diff(course, axis=0))) < 0.5e-3
