"""Early against false convergence over the threshold."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import convergence
import numpy as np
import pytest
from evaluation import comparison
from evaluation.comparison import Trial, learn_condition
from evaluation.conditions import SimulatedCondition
from evaluation.jobs import Workers
from support.tracks import made_track

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.decision.convergence import ConvergenceCriteria
from tactile_localizer.core.factory import convergence_criteria
from tactile_localizer.offline.replay import replay

CONDITION = SimulatedCondition("bump", 3, sweeps=2, blanks=1)
CONFIGURATION = Configuration(cell=1.0, update_distance=0.002)


def test_a_threshold_must_hold_over_the_travel() -> None:
    track = made_track(
        np.zeros((6, 2)), 0.001, None, probability=np.array([0.1, 0.96, 0.3, 0.96, 0.97, 0.98])
    )
    criteria = ConvergenceCriteria(np.array([0.005, 0.005]), probability=0.95, sustain=0.0015)
    np.testing.assert_array_equal(convergence.decisions(track, criteria), [False] * 4 + [True] * 2)
    assert not convergence.decisions(track, replace(criteria, probability=0.99)).any()


def test_flags_count_from_contact() -> None:
    track = made_track(np.zeros((4, 2)), 0.001, None, contact=(2, 3))
    flags = np.array([True, False, False, True])
    np.testing.assert_array_equal(convergence.from_contact(track, flags), [False, True])
    np.testing.assert_array_equal(convergence.from_contact(replace(track, contact=(-1, -1)), flags), flags)


@pytest.fixture(scope="module")
def calibration() -> dict[str, object]:
    return learn_condition(CONDITION)


def test_the_default_threshold_reproduces_the_localizer(calibration: dict) -> None:
    material = CONDITION.load()
    localizer = Trial(CONDITION, CONFIGURATION, calibration).localizer(material)
    for track in replay(localizer, material.recording):
        same = convergence.decisions(track, convergence_criteria(material.scene, CONFIGURATION))
        np.testing.assert_array_equal(same, track.converged)
        assert same.any()


def test_a_higher_threshold_converges_later(calibration: dict) -> None:
    points = convergence.decide(CONDITION, calibration, CONFIGURATION)["points"]
    assert [point["probability"] for point in points] == list(convergence.PROBABILITIES)
    for lower, higher in pairwise(points):
        for first, second in zip(lower["travel_m"], higher["travel_m"], strict=True):
            assert second is None or first <= second
        assert sum(higher["seam_strains"]) <= sum(lower["seam_strains"])


def test_the_curve_has_units(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, calibration: dict) -> None:
    monkeypatch.setattr(comparison, "learn_condition", lambda condition: calibration)
    points = convergence.convergence_curve([CONDITION], CONFIGURATION, tmp_path, Workers(1))
    table = convergence.curve_table(points, 0.99)
    assert [row[0] for row in table.rows] == ["0.9", "0.95", "0.99 *", "0.999", "0.9999"]
    assert table.columns[1:3] == ("within 5 mm, %", "within 10 mm, %")
    assert len(convergence.curve_figure(points, 0.99).axes) == 2
