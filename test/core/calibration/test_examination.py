"""The examination of a scan by its own sweeps."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree
from support.scans import raster, slides

from tactile_localizer.core.calibration import examination as module
from tactile_localizer.core.calibration.calibration import Calibration
from tactile_localizer.core.calibration.examination import (
    UNEXAMINED,
    Examination,
    conceded,
    examine,
)
from tactile_localizer.core.calibration.sweep_model import SweepModel, learn_sweep_model
from tactile_localizer.core.calibration.trials import HeldOut, Outcome, Trial
from tactile_localizer.core.configuration import Configuration
from tactile_localizer.core.factory import build_localizer, learn
from tactile_localizer.core.filters.belief import Belief
from tactile_localizer.core.likelihood.base import training_pairs
from tactile_localizer.core.likelihood.material import Material
from tactile_localizer.core.measurements import Measurement
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
    wrong = sum(each.wrong for each in examination.outcomes)
    assert wrong <= (conceded(len(examination.outcomes)) if slope else 0)
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
    calibration = learn(slides(line, x, [rng.standard_normal((len(x), 2))]), line)
    examination = calibration.examination
    assert calibration.material is Material.CLOTH, "of the level of a sweep nothing is known"
    assert examination == Examination()
    assert examination.information_length == UNEXAMINED
    assert examination.score == examination.ignorance


@pytest.fixture(scope="module")
def models() -> list[SweepModel]:
    """Of each kind of material."""
    return [learn_sweep_model(scan(0.15), SHEET, kind) for kind in Material]


def without_localizing(models: list[SweepModel]) -> tuple[Material, Examination]:
    """The chosen kind and the examination, where the test gives the outcomes of the trials."""
    criteria = SimpleNamespace(radius=np.full(2, 0.0075))

    def build(model: SweepModel, without: Sequence[np.ndarray], _: Scene) -> Any:
        one = SimpleNamespace(model=SimpleNamespace(material=model.scan.material), criteria=criteria)
        return [one] * len(without)

    chosen, examination = examine(scan(0.15), models, build)
    return list(Material)[chosen], examination


def outcome(
    trial: Trial,
    score: float = 0.0,
    wrong: bool = False,
    y: float = 0.0,
    right: bool = True,
    claimed: float = 1.0,
) -> Outcome:
    """Of a trial, with a score along ``y`` alone."""
    axes, none = (0.0, y) if trial.on_map else (), (0.0, 0.0)
    is_right = claimed > 0.0 and right and not wrong
    since = claimed if is_right or not claimed else 1.0
    return Outcome(trial.sweep.number, trial.on_map, score, is_right, wrong, claimed, since, none, none, axes)


def test_sweeps_are_held_out_that_are_spread_over_the_scan(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two passes, one after the other: no line twice while another was not held out."""
    one = scan(0.15)
    again = replace(one, sweep=one.sweep + 2 * len(one.sweep_numbers))  # others were dropped between them
    both = replace(
        one,
        **{k: np.concatenate([getattr(s, k) for s in (one, again)]) for k in ("states", "strain", "sweep")},
    )
    places: list[float] = []

    def localized(trial: Trial, *_: float) -> Outcome:
        if trial.on_map:
            places.append(float(trial.sweep.positions[0, 1]))
            assert trial.sweep.number in both.sweep_numbers
        return outcome(trial)

    monkeypatch.setattr(Trial, "_localized", localized)
    learn(both, SHEET)
    assert len(set(places)) == len(one.sweep_numbers)


@pytest.mark.parametrize("by", ["information", "explanation"])
@pytest.mark.parametrize("on_map", [True, False])
@pytest.mark.parametrize("more", [0, 1])
def test_lengths_with_more_false_claims_than_are_conceded_are_not_chosen(
    monkeypatch: pytest.MonkeyPatch, models: list[SweepModel], on_map: bool, more: int, by: str
) -> None:
    """Among the claims on the map, or in the trials off it; of the others those with most claims."""
    made, false = Counter[tuple[Any, ...]](), more + conceded(module._TRIALS)

    def localized(trial: Trial, information: float, explanation: float) -> Outcome:
        each = trial.localizer.model.material, information, explanation, trial.on_map
        is_one_of_several = trial.on_map and trial.sweep.positions[0, 0] < 0.001  # from a start
        made[each] += not is_one_of_several
        short = (information if by == "information" else explanation) < 0.004
        wrong = short and trial.on_map == on_map and not is_one_of_several and made[each] <= false
        return outcome(trial, -1.0 - information, wrong, claimed=0.9 - 10.0 * (information + explanation))

    monkeypatch.setattr(Trial, "_localized", localized)
    found = without_localizing(models)[1]
    shortest = 0.0017, 0.0017
    kept = (0.0017, 0.005) if by == "explanation" else (0.005, 0.005)
    assert (found.information_length, found.explanation_length) == (kept if more else shortest)


def test_trials_with_claims_off_the_map_decide_of_other_lengths_soonest(
    monkeypatch: pytest.MonkeyPatch, models: list[SweepModel]
) -> None:
    tried: dict[tuple[float, float], list[Trial]] = {}
    false = conceded(module._TRIALS) + 1

    def localized(trial: Trial, *lengths: float) -> Outcome:
        others = tried.setdefault(lengths, [])
        if not trial.on_map:
            others.append(trial)
        claims = tried[0.0017, 0.0017][module._FEW : module._FEW + false]
        wrong = not trial.on_map and lengths[1] < 0.004 and any(trial is each for each in claims)
        return outcome(trial, -1.0 - lengths[0], wrong)

    tried[0.0017, 0.0017] = []
    monkeypatch.setattr(Trial, "_localized", localized)
    assert without_localizing(models)[1].explanation_length == 0.005
    assert tried[0.0017, 0.003] == tried[0.0017, 0.0017][-false:]


def test_sweeps_that_are_wrong_decide_of_other_lengths_soonest(
    monkeypatch: pytest.MonkeyPatch, models: list[SweepModel]
) -> None:
    tried: list[int] = []

    def localized(trial: Trial, information: float, explanation: float) -> Outcome:
        if (information, explanation) == (0.0017, 0.003):
            tried.append(trial.sweep.number)
        wrong = trial.on_map and trial.sweep.number == 3 and explanation < 0.004
        return outcome(trial, -1.0 - information, wrong)

    monkeypatch.setattr(Trial, "_localized", localized)
    assert without_localizing(models)[1].explanation_length == 0.005
    assert set(tried) == {3}


@pytest.mark.parametrize(("lost_below", "chosen"), [(0.002, 0.003), (0.004, 0.005), (1.0, 0.0017)])
def test_a_longer_explanation_length_is_chosen_if_fewer_sweeps_are_lost_with_it(
    monkeypatch: pytest.MonkeyPatch, models: list[SweepModel], lost_below: float, chosen: float
) -> None:
    """Even if the next one only claims less. Where none is right at its end, both are the same."""

    def localized(trial: Trial, information: float, explanation: float) -> Outcome:
        ever = trial.sweep.number > 4 and lost_below < 1.0
        right = trial.on_map and (explanation > lost_below or ever)
        return outcome(trial, -1.0 - information, right=right, claimed=(0.9 - explanation) * trial.on_map)

    monkeypatch.setattr(Trial, "_localized", localized)
    found = without_localizing(models)[1]
    assert (found.information_length, found.explanation_length) == (0.0017, chosen)


def test_what_a_sweep_may_claim_with_longer_lengths_is_what_followed_its_first_claim(
    monkeypatch: pytest.MonkeyPatch, models: list[SweepModel]
) -> None:
    """Not what it claimed: a sweep that was lost on its way and found again may be lost no more."""

    def localized(trial: Trial, information: float, explanation: float) -> Outcome:
        found = outcome(trial, -1.0 - information, claimed=(0.5 + (explanation > 0.002)) * trial.on_map / 1.6)
        return replace(found, since=0.94 * trial.on_map)

    monkeypatch.setattr(Trial, "_localized", localized)
    found = without_localizing(models)[1]
    assert (found.information_length, found.explanation_length) == (0.0017, 0.003)


def test_lengths_are_given_up_once_sweeps_that_could_claim_more_do_not(
    monkeypatch: pytest.MonkeyPatch, models: list[SweepModel]
) -> None:
    """The trials of the one sweep that is lost, with as many off the map between them, but no other."""
    made = Counter[tuple[float, float, bool]]()

    def localized(trial: Trial, information: float, explanation: float) -> Outcome:
        lost = trial.on_map and trial.sweep.number == 3
        made[information, explanation, lost] += 1
        return outcome(trial, -1.0 - information, right=not lost, claimed=0.9 * trial.on_map)

    monkeypatch.setattr(Trial, "_localized", localized)
    found = without_localizing(models)[1]
    assert (found.information_length, found.explanation_length) == (0.0017, 0.0017)
    assert made[0.0017, 0.003, True] == 4
    assert made[0.0017, 0.003, False] == 5  # between six on the map, of which three are the same


def test_of_material_that_resembles_itself_claims_on_the_map_alone_decide(
    monkeypatch: pytest.MonkeyPatch, models: list[SweepModel]
) -> None:
    monkeypatch.setattr(
        Trial,
        "_localized",
        lambda trial, information, _: outcome(
            trial, -1.0 - information, not trial.on_map or information < 0.004
        ),
    )
    assert without_localizing(models)[1].information_length == 0.005


@pytest.mark.parametrize(("y", "chosen"), [(0.9, 0.0017), (1.1, 0.05)])
def test_where_an_axis_is_known_no_better_than_by_ignorance_least_is_claimed(
    monkeypatch: pytest.MonkeyPatch, models: list[SweepModel], y: float, chosen: float
) -> None:
    """Also if the whole is worse than ignorance of the place, because the map is doubted."""
    ignorance = np.log(0.015 / SHEET.extent[1])
    monkeypatch.setattr(
        Trial, "_localized", lambda trial, length, _: outcome(trial, -5.0 - length, y=y * ignorance)
    )
    found = without_localizing(models)[1]
    assert found.information_length == found.explanation_length == chosen


def test_only_where_a_kind_and_lengths_may_be_the_best_all_is_tried(
    monkeypatch: pytest.MonkeyPatch, models: list[SweepModel]
) -> None:
    made = Counter[tuple[Any, ...]]()

    def localized(trial: Trial, *lengths: float) -> Outcome:
        kind = trial.localizer.model.material
        made[(kind, *lengths, trial.on_map)] += 1
        return outcome(trial, -1.0 - abs(lengths[0] - UNEXAMINED) - (kind is Material.CLOTH))

    monkeypatch.setattr(Trial, "_localized", localized)
    _, examination = without_localizing(models)
    few, every, shorter, longer = module._FEW, module._TRIALS, 0.005, 0.015
    distinct = every - 16  # from its start each of 8 sweeps comes three times
    assert made == {
        (Material.CLOTH, UNEXAMINED, UNEXAMINED, True): few,
        (Material.SHEET, UNEXAMINED, UNEXAMINED, True): few,
        **{(Material.SHEET, each, each, True): few for each in (0.0017, 0.003, longer)},
        (Material.SHEET, shorter, shorter, True): distinct,
        (Material.SHEET, shorter, shorter, False): every,
    }
    assert len(examination.on_map) == len(examination.off_map) == every
    assert [each[:2] for each in examination.scores] == [
        (each, each) for each in (0.0017, 0.003, shorter, UNEXAMINED, longer)
    ]
    assert [each[3] is None for each in examination.scores] == [True, True, False, True, True]


@pytest.mark.parametrize(
    ("better", "right", "chosen"),
    [
        (0.3, Material.SHEET, Material.CLOTH),
        (-0.3, Material.CLOTH, Material.SHEET),
        (0.1, Material.SHEET, Material.SHEET),
        (-0.1, Material.CLOTH, Material.CLOTH),
        (0.1, None, Material.CLOTH),
        (-0.1, None, Material.CLOTH),
    ],
)
def test_of_two_kinds_with_like_scores_the_one_with_more_sweeps_right_is_chosen(
    monkeypatch: pytest.MonkeyPatch,
    models: list[SweepModel],
    better: float,
    right: Material | None,
    chosen: Material,
) -> None:
    """Scores of cloth are ``better``, and one more or less: their mean has a standard error of 0.14."""
    made = Counter[Material]()

    def localized(trial: Trial, length: float, _: float) -> Outcome:
        kind, score = trial.localizer.model.material, -5.0 - 9.0 * (length != UNEXAMINED)
        if trial.on_map and kind is Material.CLOTH:
            made[kind] += 1
            score += better + (-1.0) ** made[kind]
        return outcome(trial, score, right=right in (kind, None))

    monkeypatch.setattr(Trial, "_localized", localized)
    assert without_localizing(models)[0] is chosen


HELD = Scene("line", (Axis("x", 0.0, 0.1),), (Phalanx("index", (0.0,), 2),))


class Nearest:
    """A model of the position: a Gaussian about the nearest pair; ``claims`` scales its log-likelihood."""

    claims = 1.0

    def __init__(self, scan: Scan, scene: Scene) -> None:
        self.positions, self.strain = training_pairs(scan, scene)
        self.tree = cKDTree(self.positions)

    def log_likelihood(self, states: np.ndarray, strain: np.ndarray, present: np.ndarray) -> np.ndarray:
        residual = strain - self.strain[self.tree.query(states)[1]]
        return -0.25 * self.claims * np.square(residual).sum(axis=1)


def test_a_model_of_the_position_is_worth_what_held_out_sweeps_show(monkeypatch: pytest.MonkeyPatch) -> None:
    """A model that overstates its evidence eight times gets a longer information length."""
    known = Calibration(np.full(2, 1e-3), Material.SHEET, examination=Examination(0.005, 0.005))
    lengths = []
    for claims in (1.0, 8.0):
        monkeypatch.setattr(Nearest, "claims", claims)
        configuration = Configuration(model=f"{__name__}:Nearest")
        rng = np.random.default_rng(0)
        localizer = build_localizer(scan(0.15), SHEET, configuration, rng, calibration=known)
        assert localizer.explanation_length == 0.005
        lengths.append(localizer.information_length)
    assert lengths[1] >= 4.0 * lengths[0]


class ByHand:
    """A localizer whose claims are given: whether it has converged, and its distance from the truth, m."""

    def __init__(self, claims: list[tuple[bool, float]]) -> None:
        self.scene, self.criteria = HELD, SimpleNamespace(radius=np.array([0.0075]))
        self.explanations = SimpleNamespace(tracked=1.0)
        self._claims, self._next = claims, 0

    def reset(self) -> None:
        self._next = 0

    def measure(self, measurement: Measurement) -> Belief:
        self.converged, error = self._claims[self._next]
        self._next += 1
        self.mean = np.array([0.001 * self._next + error])
        return Belief(self.mean, 1e-6 * np.eye(1), 1.0, 1)

    def hypotheses(self) -> tuple[np.ndarray, np.ndarray]:
        return self.mean[None], np.ones(1)

    def probability_near(self, place: np.ndarray, states: np.ndarray, _: np.ndarray) -> float:
        return float(np.abs(states - place).max() <= self.criteria.radius[0])


@pytest.mark.parametrize(
    ("claims", "name"),
    [
        ([(False, 0.05), (True, 0.001)], "right"),
        ([(True, 0.001), (False, 0.001), (True, 0.0)], "right"),
        ([(True, 0.05), (True, 0.001)], "wrong"),
        ([(True, 0.001), (True, 0.05)], "wrong"),
        ([(True, 0.001), (False, 0.001)], "lost"),
        ([(False, 0.001), (False, 0.05)], "never"),
    ],
)
def test_right_is_right_at_the_end_and_never_wrong(claims: list[tuple[bool, float]], name: str) -> None:
    claims = [claim for claim in claims for _ in range(4)]
    count, rest = len(claims), (np.ones(1, dtype=bool), np.zeros(2), 0.0, False)
    positions = 0.001 * np.arange(1.0, count + 1)[:, None]
    trial = Trial(HeldOut(3, 0, positions, np.zeros((count, 2))), True, ByHand(claims))  # type: ignore[arg-type]
    step = Measurement(np.zeros(2), np.array([0.001]), 0.001, np.zeros(1), *rest)
    trial.__dict__["measurements"] = [(row, step) for row in range(count)]
    found = trial.localize(0.005, 0.005)
    assert found.since == pytest.approx(sum(np.cumsum([each for each, _ in claims]) > 0) / count)
    assert [found.right, found.wrong, found.lost] == [name == each for each in ("right", "wrong", "lost")]
    assert found.converged == (name != "never")
    assert found.error == pytest.approx((claims[-1][1],))
