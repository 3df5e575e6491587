"""Tables of an evaluation."""

from __future__ import annotations

from evaluation.tables import (
    convergence_table,
    error_table,
    evaluation_tables,
    quality_table,
    travel_table,
)
from support.evaluations import results


def row(table, method: str) -> dict[str, str]:
    (found,) = (r for r in table.rows if r[0] == method)
    return dict(zip(table.columns, found, strict=True))


def test_errors_have_intervals_and_are_relative_to_the_exact_filter() -> None:
    table = error_table(results({"gaussian-paper": {"error_contact_m": 0.00254}}))
    found = row(table, "gaussian-paper")
    assert found["bump, mm"].startswith("2.54 (2.4")
    assert found["inch"] == "0.100"
    assert found["to exact filter"] == "+27 %"
    for exact in ("default", "gaussian-paper-grid", "sum_of_gaussians-paper-grid", "featureless"):
        assert row(table, exact)["to exact filter"] == "", exact
    few = error_table(
        results({"particles-75": {"error_contact_m": 0.0022}, "default": {"error_contact_m": 0.002}})
    )
    assert row(few, "particles-75")["to exact filter"] == "+10 %"


def test_convergence_is_listed_with_false_convergence() -> None:
    found = row(convergence_table(results({"fast": {"travel_to_convergence_m": 0.02}})), "fast")
    assert (found["converged"], found["within 5 mm"], found["median, mm"]) == ("100.0 %", "0.0 %", "20.00")
    assert (found["before contact"], found["blank"]) == ("0.0 %", "0.0 %")


def test_large_numbers_stay_short() -> None:
    assert row(quality_table(results({"fast": {"nees": 123456.0}})), "fast")["NEES"] == "1.2e+05"


def test_tables_without_data_are_left_out() -> None:
    unknown = {"error_contact_m": None, "coverage_contact": None, "nees_contact": None}
    titles = [t.title for t in evaluation_tables(results(dict.fromkeys(results().methods, unknown)))]
    assert titles == ["Error", "Error along the travel", "Consistency and time"]


def test_without_contact_errors_are_by_travel() -> None:
    unfelt = {"error_contact_m": None, "error_after_travel_m": {"0.01": 0.02}, "final_error_m": 0.009}
    found = travel_table(
        results({"default": unfelt | {"error_after_travel_m": {"0.01": 0.02, "0.04": 0.006}}})
    )
    assert found.columns[2:] == ("10 mm", "40 mm", "found", "worst", "coverage")
    snap = next(r for r in found.rows if r[:2] == ("snap", "default"))
    assert snap[2:4] == ("20.00", "6.00")
    assert snap[4:6] == ("0.0 %", "9.45")


def test_conditions_with_and_without_contact_have_separate_tables() -> None:
    mixed = results()
    unfelt = [{**sweep, "error_contact_m": None} for sweep in mixed.sweeps("default", "snap")]
    for of in mixed.tasks.values():
        of[1] = {**of[1], "sweeps": unfelt}
    tables = {table.title: table for table in evaluation_tables(mixed)}
    assert "snap, mm" not in tables["Error"].columns
    assert {r[0] for r in tables["Error along the travel"].rows} == {"snap"}
    assert "Convergence" in tables
