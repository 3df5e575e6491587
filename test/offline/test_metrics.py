"""Metrics of sweeps with known errors."""

import math

import numpy as np
import pytest
from scipy import stats
from support.replays import SHEET, replayed

from tactile_localizer.offline.metrics import (
    _CHI_SQUARED_95,
    covered,
    position_error,
    statistics,
    summarize,
    timing,
    yaw_error,
)
from tactile_localizer.scene import Axis, Scene


def test_the_error_is_the_distance_from_the_truth() -> None:
    np.testing.assert_allclose(position_error(replayed([[0.003, 0.004], [0.0, -0.001]])), [0.005, 0.001])


def test_yaw_error_is_separate_and_wraps() -> None:
    scene = Scene("turning", (Axis("x", 0.0, 0.1), Axis("yaw", -math.pi, math.pi)), SHEET.phalanges)
    turned = replayed([[0.002, 2 * math.pi - 0.1]], scene=scene)
    assert position_error(turned)[0] == pytest.approx(0.002)
    assert yaw_error(turned)[0] == pytest.approx(0.1)


def test_the_95_percent_region_of_a_consistent_covariance_covers_95_percent() -> None:
    rng = np.random.default_rng(0)
    errors = 0.001 * rng.standard_normal((20000, 2))
    assert covered(replayed(errors)).mean() == pytest.approx(0.95, abs=0.01)
    assert covered(replayed(3 * errors)).mean() < 0.4
    np.testing.assert_array_equal(covered(replayed([[0.001, 0.0], [0.0, 0.0]], std=0.0)), [0, 1])
    for dimension, quantile in _CHI_SQUARED_95.items():
        assert quantile == pytest.approx(stats.chi2(dimension).ppf(0.95))


def test_without_truth_errors_are_unknown() -> None:
    unknown = replayed(np.zeros((3, 2)), truth=False)
    summary = summarize([unknown])
    assert summary["error_m"]["count"] == 0
    assert summary["error_m"]["median"] is None
    assert summary["coverage_95"] is None
    assert summary["strains"] == 3


def test_statistics_ignore_unknown_values() -> None:
    found = statistics(np.array([1.0, np.nan, 3.0]))
    assert (found["count"], found["median"], found["mean"], found["max"]) == (2, 2.0, 2.0, 3.0)


def test_convergence_is_reached_at_the_first_converged_entry() -> None:
    sweeps = [replayed(np.zeros((4, 2)), converged=[False, False, True, False]), replayed(np.zeros((4, 2)))]
    summary = summarize(sweeps)
    assert summary["travel_to_convergence_m"]["median"] == 0.002
    assert summary["converged_sweeps"] == 1


def test_travel_and_contact_are_those_of_sweeps_that_reach_it() -> None:
    touched = replayed([[0.001 * i, 0.0] for i in range(8)], contact=(2, 4), converged=np.arange(8) == 4)
    others = [replayed([[0.009, 0.0]] * 8), replayed([[0.009, 0.0]] * 8, contact=(0, 7))]
    summary = summarize([touched, *others])
    assert summary["contacts"] == 1
    assert summary["error_contact_m"]["count"] == 3
    assert summary["error_contact_m"]["mean"] == pytest.approx(0.003)
    assert summary["error_after_travel_m"]["0"]["median"] == pytest.approx(0.002)
    assert summary["error_after_travel_m"]["0.005"]["median"] == pytest.approx(0.007)
    assert summary["error_after_travel_m"]["0.01"]["count"] == 0
    assert summary["travel_to_convergence_m"]["median"] == pytest.approx(0.002)
    everywhere = summarize(others)
    assert everywhere["contacts"] == everywhere["error_contact_m"]["count"] == 0
    assert everywhere["error_after_travel_m"]["0.005"]["count"] == 2


def test_timing_separates_measurement_updates() -> None:
    found = timing([replayed(np.zeros((10, 2)))])
    assert found["update_median_us"] == pytest.approx(1000.0)
    assert found["strain_mean_us"] == pytest.approx(505.0)


def test_an_empty_sweep_is_summarized() -> None:
    summary = summarize([replayed(np.empty((0, 2))), replayed(np.zeros((3, 2)))])
    assert summary["sweeps"] == 2
    assert summary["error_m"]["count"] == 3
    assert timing([replayed(np.empty((0, 2)))])["update_median_us"] is None
