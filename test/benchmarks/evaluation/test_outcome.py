"""Outcome of a sweep: errors and convergence relative to contact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from evaluation.outcome import sweep_outcome
from support.tracks import SAMPLES, SHEET, sheet_track


def test_errors_are_separated_by_contact() -> None:
    outcome = sweep_outcome(SHEET, sheet_track())
    assert outcome["error_contact_m"] == pytest.approx(0.001)
    assert outcome["error_m"] == pytest.approx((20 * 0.010 + 30 * 0.001) / SAMPLES)
    assert outcome["nees_contact"] == pytest.approx(0.5)
    assert outcome["coverage"] == 1.0


def test_convergence_is_counted_from_contact() -> None:
    outcome = sweep_outcome(SHEET, sheet_track())
    assert outcome["converged"]
    assert not outcome["converged_before"]
    assert outcome["travel_to_convergence_m"] == pytest.approx(0.005)
    assert outcome["time_to_convergence_s"] == pytest.approx(0.05)


def test_convergence_counts_between_contact_and_feature_end() -> None:
    early = sweep_outcome(SHEET, sheet_track((30, 39)))
    assert early["converged_before"]
    assert early["travel_to_convergence_m"] == pytest.approx(-0.005)
    late = sweep_outcome(SHEET, sheet_track((5, 20)))
    assert not late["converged"]
    assert late["travel_to_convergence_m"] is None


def test_a_sweep_without_contact_lies_before_it() -> None:
    outcome = sweep_outcome(SHEET, sheet_track((-1, -1)))
    assert outcome["error_contact_m"] is None
    assert not outcome["converged_before"]


def test_a_sweep_without_usable_strain_has_no_numbers() -> None:
    whole = sheet_track()
    of_none = {
        name: value[:0]
        for name, value in vars(whole).items()
        if isinstance(value, np.ndarray | tuple) and name != "contact"
    }
    nothing = replace(whole, **of_none, refused=SAMPLES)
    for contact in ((20, 39), (-1, -1)):
        outcome = sweep_outcome(SHEET, replace(nothing, contact=contact))
        assert not outcome["converged"]
        assert outcome["error_contact_m"] is None
