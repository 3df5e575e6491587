"""The HTML report: self-contained, on screens and paper."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from evaluation.figures import evaluation_figures
from evaluation.report import save_figures, write_report
from evaluation.tables import configuration_table, evaluation_tables
from support.browser import look_at
from support.evaluations import results

from tactile_localizer.errors import ScanError
from tactile_localizer.offline.table import Table

NAMES = ["methods", "convergence"]


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> Path:
    found = results()
    path = tmp_path_factory.mktemp("report") / "report.html"
    tables = [*evaluation_tables(found), configuration_table(found)]
    write_report(path, "title", "summary", evaluation_figures(found), tables, "the <command>")
    return path


@pytest.mark.parametrize("width", [1200, 375])
def test_a_browser_shows_every_figure_within_the_page(page: Path, tmp_path: Path, width: int) -> None:
    found = look_at(page, tmp_path, width)
    assert [image["name"] for image in found["images"]] == NAMES
    for image in found["images"]:
        assert image["width"] > 300
        assert image["shown"] > 250
    assert found["loaded"] == []
    assert found["width"] <= found["view"]


def test_on_paper_no_column_is_cut_off(page: Path, tmp_path: Path) -> None:
    """A4 less its margins is 718 pixels; what is for print is shown on the screen instead."""
    text = page.read_text()
    assert "@media print {" in text
    (tmp_path / "print.html").write_text(text.replace("@media print {", "@media all {"))
    found = look_at(tmp_path / "print.html", tmp_path, 718)
    assert found["width"] <= found["view"]


def test_the_page_is_self_contained(page: Path) -> None:
    text = page.read_text()
    addresses = re.findall(r'(?:src|href)="([^"]{0,40})', text)
    assert len(addresses) == len(NAMES)
    assert all(address.startswith("data:image/svg+xml;base64,") for address in addresses)
    assert "@import" not in text
    assert "url(" not in text


def test_the_page_contains_tables_configurations_and_machine(page: Path) -> None:
    text = page.read_text()
    for heading in ("Error", "Convergence", "Configurations", "Made with"):
        assert f"<h2>{heading}</h2>" in text
    assert "the &lt;command&gt;" in text
    assert "numpy" in text
    assert "@media print" in text


def test_equal_results_give_equal_pages(tmp_path: Path) -> None:
    found = results()
    for name in ("a", "b"):
        figures = {"methods": evaluation_figures(found)["methods"]}
        write_report(tmp_path / f"{name}.html", "title", "summary", figures, [], "command")
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


def test_texts_are_escaped(tmp_path: Path) -> None:
    table = Table("t", ("<x>",), [("<script>",)], "note > note")
    write_report(tmp_path / "page.html", "a < b", "c & d", {}, [table], "command")
    text = (tmp_path / "page.html").read_text()
    assert "<script>" not in text
    assert "a &lt; b" in text
    assert "note &gt; note" in text


def test_an_unwritable_report_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ScanError, match="expected to write a report"):
        write_report(tmp_path / "file" / "page.html", "t", "s", {}, [], "command")
    with pytest.raises(ScanError, match="expected to write figures"):
        save_figures({}, tmp_path / "file" / "folder")


def test_configurations_list_changed_fields() -> None:
    rows = dict(configuration_table(results()).rows)
    assert rows["default"] == "the defaults"
    assert "particles: 75" in rows["gaussian-paper"]
    assert "position_std: 0.0022" in rows["gaussian-paper"]
