"""Pareto front of the trade-off, and choices from it."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path

from evaluation.confidence_interval import Interval
from evaluation.report import write_report
from evaluation.tradeoff import (
    BUDGETS_US,
    DEFAULT,
    Candidate,
    Trade,
    candidates,
    for_target,
    pareto_front,
    within_budget,
)
from evaluation.tradeoff_report import tradeoff_figure, tradeoff_tables
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text
from support.browser import look_at

from tactile_localizer.core.configuration import FILTERS, MODELS, Configuration
from tactile_localizer.io.configuration_file import PRESETS, load_configuration


def made(update_us: float, error_mm: float, **candidate: object) -> Trade:
    error = Interval(error_mm * 1e-3, error_mm * 0.9e-3, error_mm * 1.1e-3)
    of = Candidate(Configuration(filter="particle", particles=round(update_us)), **candidate)
    return Trade(of, error, 0.95, update_us, 2 * update_us, 3 * update_us, 10.0)


def test_no_candidate_beats_the_pareto_front() -> None:
    trades = [made(500, 2.0), made(100, 4.0), made(300, 4.5), made(200, 3.0), made(900, 2.5)]
    assert [one.update_us for one in pareto_front(trades)] == [100, 200, 500]


@given(st.lists(st.tuples(st.floats(1, 1e4), st.floats(0.1, 10)), min_size=1, max_size=30))
def test_every_trade_is_on_the_front_or_beaten_by_it(pairs: list[tuple[float, float]]) -> None:
    trades = [made(us, mm) for us, mm in pairs]
    front = pareto_front(trades)
    for one in trades:
        assert any(f.update_us <= one.update_us and f.error.mean <= one.error.mean for f in front)
    for a, b in pairwise(front):
        assert a.update_us < b.update_us
        assert a.error.mean > b.error.mean


def test_a_budget_gives_the_most_accurate_and_a_target_the_fastest() -> None:
    trades = [made(500, 2.0), made(100, 4.0), made(200, 3.0)]
    assert within_budget(trades, 250).update_us == 200
    assert within_budget(trades, 60) is None
    assert for_target(trades, 0.0035).update_us == 200
    assert for_target(trades, 0.0005) is None


def test_a_table_says_what_a_budget_loses() -> None:
    table = tradeoff_tables([made(500, 2.0), made(150, 4.0), made(250, 3.0)])[0]
    assert [(row[0], *row[2:4], *row[5:]) for row in table.rows] == [
        ("100", "", "", "", ""),
        ("200", "4.00", "+2.00", "", ""),
        ("300", "3.00", "+1.00", "", ""),
        ("500", "2.00", "+0.00", "4.00", "+2.00"),
        ("1000", "2.00", "+0.00", "3.00", "+1.00"),
    ]


def test_candidates_span_the_options_and_contain_the_presets() -> None:
    tried = candidates()
    configurations = [one.configuration for one in tried]
    assert {c.model for c in configurations} == set(MODELS)
    assert {c.filter for c in configurations} == set(FILTERS)
    assert len({c.particles for c in configurations}) >= 4
    assert {one.preset: one.configuration for one in tried if one.preset} == {
        preset: load_configuration(preset) for preset in PRESETS
    } | {DEFAULT: Configuration()}
    assert len({one.name for one in tried}) == len(tried)
    assert max(len(one.name) for one in tried) <= 60


def test_the_report_contains_figure_and_tables(tmp_path: Path) -> None:
    trades = [made(500, 2.0, preset="balanced"), made(100, 4.0, preset="fast"), made(200, 3.0)]
    trades.append(replace(made(150, 9.0), candidate=Candidate(Configuration(model="gaussian"))))
    tables, figure = tradeoff_tables(trades), tradeoff_figure(trades)
    assert [len(table.rows) for table in tables] == [len(BUDGETS_US), 3, 2, 4]
    for plot in figure.axes:
        assert {text.get_text() for text in plot.texts} == {"balanced", "fast"}
    path = tmp_path / "report.html"
    write_report(path, "title", "Tried on bump.", {"tradeoff": figure}, tables, "tactile-localizer tradeoff")
    found = look_at(path, tmp_path, 375)
    assert [image["name"] for image in found["images"]] == ["tradeoff"]
    assert found["images"][0]["width"] > 300
    assert found["width"] <= found["view"]


def test_labels_of_equal_presets_do_not_overlap() -> None:
    figure = tradeoff_figure([made(500, 2.0, preset=preset) for preset in PRESETS])
    figure.set_dpi(100)
    renderer = FigureCanvasAgg(figure).get_renderer()
    figure.draw(renderer)
    for plot in figure.axes:
        # The extent of an annotation has its line in it: wanted is that of its text.
        boxes = [Text.get_window_extent(text, renderer) for text in plot.texts]
        assert len(boxes) == len(PRESETS)
        assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
        assert all(plot.bbox.contains(*corner) for box in boxes for corner in box.corners())


def test_the_axis_of_time_has_ticks_to_read_it_by() -> None:
    presets = zip((560, 200, 150), ("default", "balanced", "fast"), strict=True)
    figure = tradeoff_figure([made(update_us, 2.0, preset=name) for update_us, name in presets])
    figure.draw_without_rendering()
    for plot in figure.axes:
        low, high = plot.get_xlim()
        assert sum(low <= tick <= high for tick in plot.get_xticks()) >= 4
