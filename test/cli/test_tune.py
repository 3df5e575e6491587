"""`tune` chooses parameters by data, shows what was tried and writes a scene with nothing left to choose."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactile_localizer.cli import main, tune
from tactile_localizer.core.likelihood.gaussian import Shrinkage
from tactile_localizer.core.likelihood.neighbours import NeighbourTrial
from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.core.selection import Trial, best_of
from tactile_localizer.evaluation.tuning import (
    best_neighbours,
    by_widths,
    neighbours_table,
    tuning_figure,
    tuning_table,
)
from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.io.scene_file import load_scene, save_scene
from tactile_localizer.sim import simulate_scan


def trial(position: float, strain: float, length: float, score: float, coverage: float = 0.99) -> Trial:
    parameters = ModelParameters([0.002 * position, 0.002 * position], [0.01 * strain] * 16, length)
    return Trial(position, strain, parameters, score, coverage)


TRIALS = [
    trial(0.5, 1.0, 0.002, 3.0),
    trial(0.5, 1.0, 0.005, 3.4),
    trial(0.5, 1.0, 0.005, 3.2),  # with another tempering by the change of strain
    trial(0.5, 2.0, 0.002, 9.0, coverage=0.5),
    trial(1.0, 1.0, 0.002, 3.1),
]
NEIGHBOURS = [
    NeighbourTrial(4, Shrinkage(0.9, 2.0, math.inf, 1.0), 1.0),
    NeighbourTrial(8, Shrinkage(0.8, 1.5, math.inf, 1.0), 1.6),
    NeighbourTrial(17, Shrinkage(0.5, 1.2, 546.0, 1.0), 1.2),
]


def test_the_best_is_honest_first() -> None:
    assert best_of(TRIALS) is TRIALS[1]
    assert by_widths(TRIALS) == [TRIALS[1], TRIALS[3], TRIALS[4]]


def test_widths_chosen_over_a_doubled_gap_are_narrower_for_the_whole_scan() -> None:
    alone = replace(TRIALS[1].parameters, position_std=np.array([0.002]), strain_std=np.full(16, 0.01))
    whole = replace(TRIALS[1], parameters=replace(alone, interpolate=True)).for_whole_scan
    assert whole.position_std == pytest.approx(0.85 * alone.position_std)
    assert whole.strain_std == pytest.approx(0.85 * alone.strain_std)
    assert replace(TRIALS[1], parameters=alone).for_whole_scan is alone


def test_the_table_marks_what_is_chosen() -> None:
    rows = tuning_table(TRIALS, ("x", "y")).rows
    assert [row[0] for row in rows] == ["*", "", ""]
    assert rows[0][1] == "x 1 mm y 1 mm"
    assert rows[0][3] == "5"


def test_the_neighbours_of_the_best_score_are_chosen_and_marked() -> None:
    assert best_neighbours(NEIGHBOURS) is NEIGHBOURS[1]
    assert [row[:5] for row in neighbours_table(NEIGHBOURS).rows] == [
        ("", "4", "0.90", "inf", "1"),
        ("*", "8", "0.80", "inf", "1"),
        ("", "17", "0.50", "546", "1"),
    ]


def test_the_picture_has_a_line_for_each_position_width() -> None:
    widths, lengths, neighbours, coverage = tuning_figure(TRIALS, NEIGHBOURS).axes
    labels = [text.get_text() for text in widths.get_legend().get_texts()]
    assert labels == ["S_x at 0.5 of the sweeps' spacing", "S_x at 1 of the sweeps' spacing"]
    assert list(lengths.get_lines()[0].get_xdata()) == [2.0, 5.0]
    assert list(lengths.get_lines()[0].get_ydata()) == [3.0, 3.4]
    assert list(neighbours.get_lines()[0].get_xdata()) == [4, 8, 17]
    assert coverage.get_ylabel() == "coverage of the 95 % region"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, data_dir: Path) -> Path:
    monkeypatch.chdir(tmp_path)
    files = [f"{repeat}.csv" for repeat in range(2)]
    for repeat, file in enumerate(files):
        whole = data_dir / "fabric_slide" / f"Linen_F250_V10mmps_{repeat}.csv"
        Path(file).write_text("".join(whole.read_text().splitlines(keepends=True)[:110]))  # 30 mm
    reading = ["--columns", "fabric_slide.yaml", "--speed", "0.01", "--scene", "linen.yaml"]
    assert main(["import", "csv", *files, *reading, "-o", "scan.db"]) == 0
    return tmp_path


def test_linen_is_tuned_into_a_scene_that_replay_takes_as_it_is(folder: Path, capsys) -> None:
    assert main(["tune", "--scan", "scan.db", "-o", "tuned.yaml"]) == 0
    printed = capsys.readouterr().out
    assert "Kernel widths" in printed
    assert "Neighbours" in printed
    assert "tuned.yaml, tuned.png" in printed
    tuned = load_scene("tuned.yaml")
    assert ModelParameters.from_mapping(tuned.measurement).complete
    assert len(tuned.measurement["strain_std"]) == 16
    assert Path("tuned.png").stat().st_size > 5000
    assert (
        main(
            [
                "replay",
                "scan.db",
                "--scan",
                "scan.db",
                "--scene",
                "tuned.yaml",
                "--starts",
                "1",
                "--travel",
                "0.02",
            ]
        )
        == 0
    )


def test_what_the_scene_said_is_replaced_by_what_was_chosen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tune, "search", lambda scan, scene, progress: TRIALS)
    monkeypatch.setattr(tune, "search_neighbours", lambda scan, scene, progress: NEIGHBOURS)
    scene = load_scene(Path(__file__).parents[2] / "config/scenes/bump.yaml")
    save_scene(replace(scene, measurement={"neighbours": 12}), "scene.yaml")
    train = simulate_scan("bump", 1, sweeps=1)
    with ScanStore.create("scan.db", scene) as store:
        store.begin_sweep()
        store.append(train.stamp_ns, train.odometry, train.strain)
        store.end_sweep()
    assert main(["tune", "--scan", "scan.db", "--scene", "scene.yaml", "-o", "tuned.yaml"]) == 0
    measurement = load_scene("tuned.yaml").measurement
    assert measurement["neighbours"] == 8
    assert measurement["correlation_length"] == 0.005
