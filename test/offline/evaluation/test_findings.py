"""The paper's findings are judged by the numbers, with room for doubt."""

from __future__ import annotations

import numpy as np
import pytest
from support.evaluations import results

from tactile_localizer.offline.evaluation.confidence_interval import mean_interval
from tactile_localizer.offline.evaluation.findings import (
    FEATURELESS,
    GAUSSIAN,
    HELD,
    INDEPENDENT,
    NOT_HELD,
    OPEN,
    SUM,
    check_findings,
    own_criterion,
    plain_criteria,
)


def verdict(results, words: str) -> str:
    (found,) = (f for f in check_findings(results) if words in f.statement)
    return found.verdict


@pytest.mark.parametrize(("error", "expected"), [(0.002, HELD), (0.0026, OPEN), (0.004, NOT_HELD)])
def test_a_tenth_of_an_inch_is_judged_by_the_interval(error: float, expected: str) -> None:
    found = results({"default": {"error_contact_m": error}})
    assert verdict(found, "one tenth of an inch") in ({expected} if error != 0.0026 else {OPEN, NOT_HELD})


def test_each_finding_is_held_where_the_numbers_say_so() -> None:
    after = [0.004, 0.003, 0.0015, 0.002, 0.002, 0.003, 0.003, 0.003, 0.003, 0.003, 0.003, 0.003]
    found = results(
        {
            GAUSSIAN: {
                "error_contact_m": 0.003,
                "error_after_contact_m": after,
                "lowest_trace_before_m2": 1e-6,
            },
            INDEPENDENT: {"error_contact_m": 0.0025, "highest_marginal_before": 50.0},
            FEATURELESS: {"trace_before_m2": 4e-4},
            SUM: {"error_past_m": [0.002, 0.003, 0.004] + [None] * 9},
        }
    )
    verdicts = {f.statement: f.verdict for f in check_findings(found)}
    held = [
        "Before contact, both Gaussian models perform about equally well.",
        "After contact there is a small advantage to no covariance between the fingers.",
        "The Gaussian model's error grows again once the edge of the feature is passed.",
        "Just at contact there is little advantage to the sum of Gaussians.",
        "After that, the sum of Gaussians localises better than the Gaussian model.",
        "Low covariance alone or high likelihood alone falsely signal convergence before contact.",
        "Modelling featureless regions apart leaves the error about the same.",
        "Modelling featureless regions apart keeps the belief broader before contact.",
        "Convergence is recognized without false alarms where no feature is (this package's criterion).",
        "Past the feature the error grows no faster than the motion noise (default).",
        "Past the feature constant injection forgets faster than the motion noise (the paper's form).",
    ]
    assert {statement: verdicts[statement] for statement in held} == dict.fromkeys(held, HELD)


def test_the_opposite_numbers_are_not_held() -> None:
    found = results(
        {
            INDEPENDENT: {"error_contact_m": 0.003, "error_before_m": 0.03},
            FEATURELESS: {"trace_before_m2": 1e-5, "error_contact_m": 0.009},
            SUM: {"error_after_contact_m": [0.04] * 12},
        },
        blanks={"default": {"converged": True}},
    )
    found_past = results({"default": {"error_past_m": [0.004] * 6 + [None] * 6}})
    assert verdict(found_past, "no faster than the motion noise") == NOT_HELD
    for words in (
        "both Gaussian models",
        "no covariance between",
        "little advantage to the sum",
        "localises better",
        "leaves the error",
        "without false alarms",
    ):
        assert verdict(found, words) == NOT_HELD, words


def test_plain_criteria_fire_where_the_threshold_is_passed_too_early() -> None:
    found = results(
        {SUM: {"lowest_trace_before_m2": 1e-6, "highest_marginal_before": 10.0}},
        blanks={SUM: {"lowest_trace_blank_m2": 1e-3, "highest_marginal_blank": 60.0}},
    )
    alarms = plain_criteria(found, SUM)
    assert (alarms["low trace"].before, alarms["low trace"].blank) == (1.0, 0.0)
    assert (alarms["high likelihood"].before, alarms["high likelihood"].blank) == (0.0, 1.0)
    assert alarms["low trace"].threshold == pytest.approx(3.2e-5)
    assert own_criterion(found, SUM).before == 0.0


def test_findings_of_methods_that_were_not_tried_are_left_out() -> None:
    found = results()
    some = type(found)(found.conditions, {"default": found.methods["default"]}, found.tasks)
    assert [f.source for f in check_findings(some)] == ["Abstract", "III-D, aim", "III, motivation"]


def test_an_interval_covers_the_mean_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    intervals = [mean_interval(rng.normal(1.0, 2.0, 60)) for _ in range(200)]
    covered = np.mean([i.low <= 1.0 <= i.high for i in intervals])
    assert 0.89 <= covered <= 0.99
    assert mean_interval(np.array([np.nan, np.nan])) is None
