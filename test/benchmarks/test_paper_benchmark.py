"""The paper's findings: verdicts from confidence intervals, and its figures."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest
from support.evaluations import results

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
paper = importlib.import_module("paper")

FEATURELESS, GAUSSIAN, INDEPENDENT, SUM = paper.FEATURELESS, paper.GAUSSIAN, paper.INDEPENDENT, paper.SUM
HELD, NOT_HELD, OPEN = paper.HELD, paper.NOT_HELD, paper.OPEN


def verdict(results, words: str) -> str:
    (found,) = (f for f in paper.check_findings(results) if words in f.statement)
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
    verdicts = {f.statement: f.verdict for f in paper.check_findings(found)}
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
    alarms = paper.plain_criteria(found, SUM)
    assert (alarms["low trace"].before, alarms["low trace"].blank) == (1.0, 0.0)
    assert (alarms["high likelihood"].before, alarms["high likelihood"].blank) == (0.0, 1.0)
    assert alarms["low trace"].threshold == pytest.approx(3.2e-5)
    assert paper.own_criterion(found, SUM).before == 0.0


def test_findings_of_methods_that_were_not_tried_are_left_out() -> None:
    found = results()
    some = type(found)(found.conditions, {"default": found.methods["default"]}, found.tasks)
    assert [f.source for f in paper.check_findings(some)] == ["Abstract", "III-D, aim", "III, motivation"]


def lines(plot) -> dict[str, np.ndarray]:
    return {line.get_label(): line.get_ydata() for line in plot.get_lines()}


def test_figure_5_has_the_mean_error_of_the_papers_three_models_in_mm() -> None:
    found = results(
        {SUM: {"error_curve_m": [0.003] * 50}, GAUSSIAN: {"error_curve_m": [None] * 25 + [0.006] * 25}}
    )
    (plot,) = paper.error_along_sweep(found, "bump").axes
    drawn = lines(plot)
    assert set(drawn) == {"Gaussian", "Gaussian, fingers apart", "sum of Gaussians"}
    np.testing.assert_allclose(drawn["sum of Gaussians"], 3.0)
    assert len(drawn["Gaussian"]) == 25


def test_figure_8_has_error_and_trace_with_and_without_featureless_regions() -> None:
    found = results({SUM: {"trace_curve_m2": [5e-6] * 50}})
    error, trace = paper.error_and_trace(found, "snap").axes
    assert set(lines(error)) == set(lines(trace)) == {"featureless apart", "sum of Gaussians"}
    np.testing.assert_allclose(lines(trace)["sum of Gaussians"], 5.0)


def test_the_plain_criteria_are_listed_below_the_default_one() -> None:
    table = paper.criteria_table(results())
    assert [r[1] for r in table.rows[:3]] == ["probability", "low trace", "high likelihood"]
    assert table.rows[1][2] == "32 mm²"
