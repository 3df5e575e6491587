"""Metrics of sweeps with known errors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tactile_localizer.core.hypotheses.convergence import State
from tactile_localizer.offline.metrics import (
    calibration,
    error_at,
    position_error,
    statistics,
    summarize,
    timing,
    travel_to_convergence,
    yaw_error,
)
from tactile_localizer.offline.replay import ReplayedSweep
from tactile_localizer.scene import Axis, Phalanx, Scene

SCENE = Scene("sheet", (Axis("x", 0.0, 0.1), Axis("y", 0.0, 0.1)), (Phalanx("index", (0.0, 0.0)),))


def sweep(errors, *, converged=None, truth=True, std=0.001, contact=(-1, -1)) -> ReplayedSweep:
    """Entries 1 mm of travel apart whose estimates are off by ``errors`` (n, 2), m."""
    errors = np.asarray(errors, dtype=float)
    n = len(errors)
    places = np.zeros((n, 2))
    places[:, 0] = 0.001 * np.arange(n)
    flags = np.zeros(n, dtype=bool) if converged is None else converged
    return ReplayedSweep(
        number=0,
        row=np.arange(n),
        stamp_ns=np.arange(n, dtype=np.int64),
        mean=places + errors,
        covariance=np.broadcast_to(std**2 * np.eye(2), (n, 2, 2)),
        state=tuple(State.CONVERGED if flag else State.SEARCHING for flag in flags),
        probability=np.zeros(n),
        on_map=np.zeros(n),
        log_marginal=np.zeros(n),
        updated=np.arange(n) % 2 == 0,
        reason=("",) * n,
        truth=places if truth else None,
        travel=places[:, 0],
        seconds=np.where(np.arange(n) % 2 == 0, 1e-3, 1e-5),
        refused=0,
        contact=contact,
    )


def test_the_error_is_the_distance_from_the_truth() -> None:
    np.testing.assert_allclose(position_error(SCENE, sweep([[0.003, 0.004], [0.0, -0.001]])), [0.005, 0.001])


def test_yaw_error_is_separate_and_wraps() -> None:
    scene = Scene("turning", (Axis("x", 0.0, 0.1), Axis("yaw", -math.pi, math.pi)), SCENE.phalanges)
    turned = sweep([[0.002, 2 * math.pi - 0.1]])
    assert position_error(scene, turned)[0] == pytest.approx(0.002)
    assert yaw_error(scene, turned)[0] == pytest.approx(0.1)


def test_a_degenerate_covariance_gives_finite_metrics() -> None:
    collapsed = sweep([[0.001, 0.0], [0.0, 0.0]], std=0.0)
    assert calibration(SCENE, [collapsed])["coverage_95"] == 0.5
    assert calibration(SCENE, [collapsed])["nees"] > 1e6


def test_without_truth_errors_are_unknown() -> None:
    unknown = sweep(np.zeros((3, 2)), truth=False)
    summary = summarize(SCENE, [unknown])
    assert summary["error_m"]["count"] == 0
    assert summary["error_m"]["median"] is None
    assert summary["nees"] is None
    assert summary["strains"] == 3


def test_a_consistent_covariance_has_nees_one_and_covers_95_percent() -> None:
    rng = np.random.default_rng(0)
    honest = calibration(SCENE, [sweep(0.001 * rng.standard_normal((20000, 2)))])
    assert honest["nees"] == pytest.approx(1.0, abs=0.03)
    assert honest["coverage_95"] == pytest.approx(0.95, abs=0.01)
    boastful = calibration(SCENE, [sweep(0.003 * rng.standard_normal((20000, 2)))])
    assert boastful["nees"] == pytest.approx(9.0, rel=0.05)
    assert boastful["coverage_95"] < 0.4


def test_statistics_ignore_unknown_values() -> None:
    found = statistics(np.array([1.0, np.nan, 3.0]))
    assert (found["count"], found["median"], found["mean"], found["max"]) == (2, 2.0, 2.0, 3.0)


def test_the_error_at_a_mark_is_of_long_enough_sweeps() -> None:
    short, long = sweep([[0.009, 0.0]] * 5), sweep([[0.001 * i, 0.0] for i in range(20)])
    errors = [position_error(SCENE, t) for t in (short, long)]
    np.testing.assert_allclose(error_at(errors, [short, long], 0.004), [0.009, 0.004])
    np.testing.assert_allclose(error_at(errors, [short, long], 0.01), [0.010])


def test_convergence_is_reached_at_the_first_converged_entry() -> None:
    sweeps = [sweep(np.zeros((4, 2)), converged=[False, False, True, False]), sweep(np.zeros((4, 2)))]
    np.testing.assert_array_equal(travel_to_convergence(sweeps), [0.002, np.nan])
    summary = summarize(SCENE, sweeps)
    assert summary["converged_sweeps"] == 1
    assert summary["converged_fraction"] == 1 / 8


def test_errors_on_contact_are_those_from_contact_to_the_features_end() -> None:
    errors = [[0.0, 0.02], [0.0, 0.02], [0.0, 0.001], [0.0, 0.003], [0.0, 0.02]]
    summary = summarize(SCENE, [sweep(errors, contact=(2, 3))])
    assert summary["error_contact_m"]["count"] == 2
    assert summary["error_contact_m"]["mean"] == pytest.approx(0.002)


def test_travel_is_counted_from_contact_where_it_is_known() -> None:
    touched = sweep([[0.001 * i, 0.0] for i in range(8)], contact=(2, 7), converged=np.arange(8) == 4)
    blank = sweep([[0.009, 0.0]] * 8)
    summary = summarize(SCENE, [touched, blank])
    assert summary["contacts"] == 1
    assert summary["error_after_travel_m"]["0"]["median"] == pytest.approx(0.002)
    assert summary["error_after_travel_m"]["0.005"]["median"] == pytest.approx(0.007)
    assert summary["travel_to_convergence_m"]["median"] == pytest.approx(0.002)


def test_timing_separates_measurement_updates() -> None:
    found = timing([sweep(np.zeros((10, 2)))])
    assert found["update_median_us"] == pytest.approx(1000.0)
    assert found["strain_mean_us"] == pytest.approx(505.0)


def test_an_empty_sweep_is_summarized() -> None:
    summary = summarize(SCENE, [sweep(np.empty((0, 2))), sweep(np.zeros((3, 2)))])
    assert summary["sweeps"] == 2
    assert summary["error_m"]["count"] == 3
    assert timing([sweep(np.empty((0, 2)))])["update_median_us"] is None
