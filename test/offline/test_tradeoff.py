"""The trade-off: candidates on a recording, the Pareto front, the choice."""

from copy import copy
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from support.sweeps import CALIBRATION

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.errors import ParameterError
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.offline.tradeoff import (
    Candidate,
    Trade,
    candidates,
    for_target,
    pareto_front,
    trade,
)
from tactile_localizer.offline.verdict import Verdict
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import Scene
from tactile_localizer.sim import simulate_recording, simulate_scan

BUMP = load_scene(resource_path("config/scenes/bump.yaml"))
COARSE = [
    Candidate("coarse", Configuration(cell=1.0, update_distance=0.003)),
    Candidate("particles", Configuration(filter="particle", particles=75, update_distance=0.003)),
]


def trade_of(errors: list[float], us_per_mm: float, wrong: int = 0) -> Trade:
    verdict = Verdict(1, 1, 1 - wrong, wrong, 0, 0, 0, True, ())
    return Trade(Candidate("", Configuration()), np.array(errors), 1.0, verdict, 1, 1, us_per_mm)


def test_the_front_has_what_no_other_beats_in_error_time_and_wrong_sweeps() -> None:
    trades = [trade_of([2.0], 300), trade_of([3.0], 100, wrong=1), trade_of([2.5], 400), trade_of([3.5], 200)]
    assert [one.us_per_mm for one in pareto_front(trades)] == [300, 100, 200]


def test_the_target_is_met_by_the_fastest_of_the_fewest_wrong_sweeps() -> None:
    trades = [trade_of([0.002], 600), trade_of([0.0025], 300), trade_of([0.0026], 100, wrong=1)]
    assert for_target(trades, 0.0028) is trades[1]
    assert for_target(trades[2:], 0.0028) is trades[2]
    assert for_target(trades, 0.001) is None


def test_differences_are_those_of_the_same_sweeps() -> None:
    one, other = trade_of([1.0, 5.0, np.nan, 9.0], 1), trade_of([2.0, 7.0, 1.0, 12.0], 1)
    mean, half_width = one.difference(other)
    assert mean == pytest.approx(-2.0)
    assert half_width == pytest.approx(4.303 / np.sqrt(3), abs=1e-3)  # t quantile of 2 degrees of freedom


def test_candidates_are_what_the_scene_can_have() -> None:
    found = candidates(BUMP)
    assert len({one.configuration for one in found}) == len(found) == len({one.name for one in found})
    assert found[0].changes == {}
    assert Configuration(**found[-1].changes) == found[-1].configuration
    line = Scene("line", BUMP.axes[:1], (replace(BUMP.phalanges[0], offset=(0.0,)),))
    assert {one.configuration.cell for one in candidates(line)} == {Configuration().cell}


SCAN = simulate_scan("bump", 1, sweeps=11)
RECORDING = simulate_recording("bump", 1, "test", sweeps=2)
LOAD, READ = partial(copy, SCAN), [partial(copy, (RECORDING, "recorded"))]


def test_a_candidate_that_fails_costs_its_row_only() -> None:
    absent = Candidate("absent", Configuration(model="no.such.module:Model"))
    steps: list[tuple[str, float]] = []
    measured = [absent, *COARSE]
    report = lambda *step: steps.append(step)  # noqa: E731
    trades, failed = trade(LOAD, BUMP, READ, measured, CALIBRATION, progress=report)
    assert [done for _, done in steps] == sorted(done for _, done in steps)
    assert {("replaying", number / 3) for number in (1, 2, 3)} <= {*steps}
    assert [one.candidate.name for one in trades] == ["coarse", "particles"]
    assert failed["absent"].startswith("model 'no.such.module:Model': expected")


@pytest.mark.slow
def test_two_processes_find_the_same() -> None:
    (here, _), (there, _) = (trade(LOAD, BUMP, READ, COARSE, CALIBRATION, jobs=jobs) for jobs in (1, 2))
    for one, other in zip(here, there, strict=True):
        assert one.error == other.error < 0.01
        assert one.verdict == other.verdict


def test_what_cannot_be_measured_is_refused() -> None:
    unknown = replace(RECORDING, sweeps=(replace(RECORDING.sweeps[0], truth=None),))
    with pytest.raises(ParameterError, match="simulated bump: expected true positions, found none"):
        trade(LOAD, BUMP, [lambda: (unknown, "recorded")], COARSE, CALIBRATION)
    with pytest.raises(ParameterError, match="jobs: expected at least 1, or -1 for one per core, got 0"):
        trade(LOAD, BUMP, READ, COARSE, CALIBRATION, jobs=0)
