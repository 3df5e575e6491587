"""The examination of a scan by its own sweeps."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from support.scans import raster, slides

from tactile_localizer.core.calibration import examination as module
from tactile_localizer.core.calibration.examination import (
    UNEXAMINED,
    Examination,
    Outcome,
    _Trial,
)
from tactile_localizer.core.factory import learn
from tactile_localizer.core.scan.scan import Scan
from tactile_localizer.scene import Axis, Phalanx, Scene

SHEET = Scene(
    "sheet",
    (Axis("x", 0.0, 0.05, 0.003), Axis("y", 0.0, 0.04, 0.003)),
    (Phalanx("index", (0.0, 0.0), 4), Phalanx("thumb", (0.0, 0.0), 4)),
)


def scan(slope: float) -> Scan:
    """A seam across the lines, 10 V high, whose strain changes along it by ``slope`` per mm; noise of 1 V."""
    rng = np.random.default_rng(0)

    def strain(states: np.ndarray, _: np.ndarray) -> np.ndarray:
        seam = 10.0 * np.exp(-0.5 * ((states[:, 0] - 0.025) / 0.003) ** 2)
        turned = slope * 1e3 * (states[:, 1:] - 0.02) + np.linspace(0.0, 3.0, 8)
        return seam[:, None] * np.sin(turned) + rng.standard_normal((len(states), 8))

    return raster(SHEET, strain, spacing=0.004)


@pytest.fixture(scope="module", params=[0.0, 0.15], ids=["seam", "feature"])
def examined(request: pytest.FixtureRequest) -> tuple[float, Examination]:
    return request.param, learn(scan(request.param), SHEET).examination


def test_an_axis_along_which_nothing_differs_is_not_observed(examined: tuple[float, Examination]) -> None:
    slope, examination = examined
    assert examination.observed[0] > 0.5
    assert (examination.observed[1] > 0.5) == (slope > 0.0)


def test_where_places_cannot_be_distinguished_none_is_claimed(examined: tuple[float, Examination]) -> None:
    slope, examination = examined
    right = sum(each.right for each in examination.on_map)
    assert not any(each.wrong for each in examination.outcomes)
    assert right > 0.5 * len(examination.on_map) if slope else right == 0


def test_a_hand_may_rest_in_the_sweeps_of_a_scan() -> None:
    """At the begin or at the end, for longer than it slides, with an arm whose position trembles."""
    rng, slid = np.random.default_rng(1), scan(0.15)
    rows = []
    for number in slid.sweep_numbers:
        own = np.flatnonzero(slid.sweep == number)
        rest = np.full(2 * len(own), own[-1 if number % 2 else 0])
        rows += [own, rest] if number % 2 else [rest, own]
    row = np.concatenate(rows)
    states = slid.states[row] + 1e-5 * rng.standard_normal((len(row), 2))
    strain = slid.strain[row] + rng.standard_normal((len(row), 8))
    resting = learn(replace(slid, states=states, strain=strain, sweep=slid.sweep[row]), SHEET).examination
    assert (resting.observed > 0.5).all()
    assert sum(each.right for each in resting.on_map) > 0.5 * len(resting.on_map)


def test_the_score_is_beside_that_of_ignorance(examined: tuple[float, Examination]) -> None:
    slope, examination = examined
    area = np.pi * 0.0075**2 / np.prod(SHEET.extent + 0.0)
    assert examination.ignorance == pytest.approx(np.log(area), abs=0.1)
    assert examination.score > examination.ignorance or not slope


def test_a_single_sweep_cannot_be_examined() -> None:
    line = Scene("line", (Axis("x", 0.0, 0.1),), (Phalanx("index", (0.0,), 2),))
    x, rng = np.arange(0.0, 0.1, 0.0005), np.random.default_rng(0)
    examination = learn(slides(line, x, [rng.standard_normal((len(x), 2))]), line).examination
    assert examination == Examination()
    assert examination.information_length == UNEXAMINED
    assert examination.score == examination.ignorance


def outcome(trial: _Trial, score: float = 0.0, wrong: bool = False, y: float = 0.0) -> Outcome:
    """Of a trial, with a score along ``y`` alone."""
    axes = (0.0, y) if trial.on_map else ()
    return Outcome(trial.sweep.number, trial.on_map, score, True, wrong, True, (0.0,) * 2, (0.0,) * 2, axes)


def test_sweeps_are_held_out_that_are_spread_over_the_scan(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two passes, one after the other: no line twice while another was not held out."""
    one = scan(0.15)
    again = replace(one, sweep=one.sweep + 2 * len(one.sweep_numbers))  # others were dropped between them
    both = replace(
        one,
        **{k: np.concatenate([getattr(s, k) for s in (one, again)]) for k in ("states", "strain", "sweep")},
    )
    places: list[float] = []

    def localized(trial: _Trial, _: float) -> Outcome:
        if trial.on_map:
            places.append(float(trial.sweep.positions[0, 1]))
            assert trial.sweep.number in both.sweep_numbers
        return outcome(trial)

    monkeypatch.setattr(module, "_localize", localized)
    learn(both, SHEET)
    assert len(set(places)) == len(one.sweep_numbers)


@pytest.mark.parametrize(("claims", "chosen"), [(1, 0.0017), (2, 0.005)])
def test_a_length_with_more_false_claims_than_chance_is_not_chosen(
    monkeypatch: pytest.MonkeyPatch, claims: int, chosen: float
) -> None:
    """Of the others the score on the map decides."""
    made = Counter[float]()
    score = {0.0017: -0.9, 0.003: -1.0, 0.005: -1.1}

    def localized(trial: _Trial, length: float) -> Outcome:
        made[length] += 1
        return outcome(trial, score.get(length, -5.0), length < 0.004 and made[length] <= claims)

    monkeypatch.setattr(module, "_localize", localized)
    assert learn(scan(0.15), SHEET).examination.information_length == chosen


@pytest.mark.parametrize(("y", "chosen"), [(0.9, 0.0017), (1.1, 0.05)])
def test_where_an_axis_is_known_no_better_than_by_ignorance_least_is_claimed(
    monkeypatch: pytest.MonkeyPatch, y: float, chosen: float
) -> None:
    """Also if the whole is worse than ignorance of the place, because the map is doubted."""
    ignorance = np.log(0.015 / SHEET.extent[1])
    monkeypatch.setattr(
        module, "_localize", lambda trial, length: outcome(trial, -5.0 - length, y=y * ignorance)
    )
    assert learn(scan(0.0), SHEET).examination.information_length == chosen
