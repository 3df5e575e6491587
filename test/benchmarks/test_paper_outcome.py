"""Outcome of a sweep for the paper's figures: curves along the sweep, plain criteria."""

from __future__ import annotations

import importlib
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from evaluation.comparison import Trial
from support.evaluations import CALIBRATION, QUICK, condition
from support.tracks import SHEET, sheet_track

from tactile_localizer.scene import DEFAULT_MOTION_STD

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
own = importlib.import_module("paper_outcome")


def test_parts_are_separated_by_contact() -> None:
    outcome = own.paper_outcome(SHEET, sheet_track(), axis=0)
    assert outcome["error_before_m"] == pytest.approx(0.010)
    assert outcome["contact_m"] == pytest.approx([0.0205, 0.0395])
    assert outcome["trace_before_m2"] == pytest.approx(2e-4)
    never = own.paper_outcome(SHEET, sheet_track((-1, -1)), axis=0)
    assert never["contact_m"] is None
    assert never["error_before_m"] == pytest.approx(never["error_m"])


def test_a_trial_has_curves_along_its_sweeps() -> None:
    trial = Trial(condition(), QUICK[0].configuration, CALIBRATION)
    found = own.localize(trial)
    assert found["axis"] == "x"
    assert np.isclose(np.diff(found["edges_m"]), 0.0528 / 50).all()
    assert 0.0 < found["narrow_trace_m2"] < 2 * trial.configuration.convergence_radius**2
    assert len(found["sweeps"]) == 2


def test_plain_criteria_are_recorded_for_each_part() -> None:
    outcome = own.paper_outcome(SHEET, sheet_track(), axis=0)
    assert outcome["highest_marginal_before"] == pytest.approx(29.0)
    assert outcome["highest_marginal_contact"] == pytest.approx(49.0)
    assert outcome["lowest_trace_before_m2"] == pytest.approx(2e-4)
    assert outcome["lowest_trace_contact_m2"] == pytest.approx(2e-6)
    blank = own.blank_outcome(sheet_track())
    assert blank["converged"]
    assert blank["lowest_trace_blank_m2"] == pytest.approx(2e-6)


def test_curves_follow_the_sweep_axis_and_the_travel_after_contact() -> None:
    outcome = own.paper_outcome(SHEET, sheet_track(), axis=0)
    curve = outcome["error_curve_m"]
    assert len(curve) == own.BINS
    assert curve[0] == pytest.approx(0.010)
    assert curve[-1] == pytest.approx(0.001)
    after = outcome["error_after_contact_m"]
    assert after[0] == pytest.approx(0.001)
    assert after[7] == pytest.approx(0.001)
    assert after[8] is None  # past the feature's end


def test_error_past_the_feature_is_beside_that_of_motion_alone() -> None:
    outcome = own.paper_outcome(SHEET, sheet_track(), axis=0)
    assert outcome["error_past_m"][:5] == pytest.approx([0.001] * 5)
    assert outcome["error_past_m"][5] is None, "the sweep is over"
    gone = np.array([3, 4]) * 1e-3
    noise = 2 * DEFAULT_MOTION_STD**2 * gone
    assert outcome["motion_past_m"][1] == pytest.approx(np.mean(np.sqrt(1e-6 + noise)), rel=0.01)
    never = own.paper_outcome(SHEET, sheet_track((-1, -1)), axis=0)
    assert never["error_past_m"] == never["motion_past_m"] == [None] * 12


def test_the_sweep_axis_is_the_one_that_the_sweeps_span() -> None:
    along_x = sheet_track()
    along_y = replace(along_x, truth=along_x.truth[:, ::-1].copy())
    assert own.sweep_axis(SHEET, [along_x]) == 0
    assert own.sweep_axis(SHEET, [along_y]) == 1
