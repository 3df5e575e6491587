"""The benchmark that measures accuracy against computing time."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import tradeoff
import yaml
from evaluation.tradeoff import Candidate

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.io.configuration_file import load_configuration

FEW = [
    Candidate(Configuration(filter="particle", particles=50, update_distance=0.001)),
    Candidate(Configuration(filter="particle", particles=400)),
    Candidate(load_configuration("fast"), preset="fast"),
    Candidate(Configuration(model="gaussian", filter="particle", particles=50, update_distance=0.002)),
]


@pytest.fixture
def command(bump_folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    monkeypatch.setattr(tradeoff, "candidates", lambda: FEW)
    return ["test.csv", "--scan", "scan.db", "--starts", "2", "--travel", "0.02", "-o", "out"]


def test_all_candidates_are_printed_and_written(command: list[str], capsys) -> None:
    assert tradeoff.main(command) == 0
    printed = capsys.readouterr().out
    assert "Pareto front" in printed
    assert "fast: sweep_mixture grid" in printed
    trades = json.loads(Path("out/tradeoff.json").read_text())["trades"]
    assert len(trades) == len(FEW)
    for one in trades:
        mean, low, high = one["error"]
        assert 0 < low <= mean <= high
        assert 0 < one["update_us"] <= one["update_p99_us"]
        assert one["us_per_mm"] > 0
        assert one["memory_mb"] > 0
    assert Path("out/tradeoff.png").exists()
    assert "scan.db" in Path("out/report.html").read_text()


def test_a_budget_gives_a_usable_configuration(command: list[str], capsys) -> None:
    assert tradeoff.main([*command, "--budget-us", "1e6"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("# most accurate within 1e+06 µs: ")
    Path("answer.yaml").write_text(printed)
    assert load_configuration("answer.yaml") in [one.configuration for one in FEW]
    for name, value in yaml.safe_load(printed).items():
        assert f"-p {name}:={value}" in printed


def test_a_target_gives_the_fastest_configuration(command: list[str], capsys) -> None:
    assert tradeoff.main([*command, "--target-mm", "1000"]) == 0
    assert "# fastest within 1000 mm: " in capsys.readouterr().out


def test_an_unmet_request_names_the_nearest_and_gives_status_1(command: list[str], capsys) -> None:
    assert tradeoff.main([*command, "--budget-us", "0.1", "--target-mm", "1e-6"]) == 1
    printed = capsys.readouterr().out
    assert printed.count("none; nearest is ") == 2


def test_a_budget_of_zero_is_refused(command: list[str], capsys) -> None:
    assert tradeoff.main([*command, "--budget-us", "0"]) == 2
    assert "--budget-us" in capsys.readouterr().err
