"""Figures of localization stay what they are: `benchmarks/recorded.py` on three recordings, and with noise.

`figures.csv` has each figure with its tolerance: two standard errors, from the spread over the sweeps, and at
least 1 %. After a change that is meant to alter figures, write them anew and look at the difference:

    WRITE_FIGURES=1 scripts/in_env python -m pytest test/regression
"""

from __future__ import annotations

import csv
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded import Variant, measure_folder
from rows import in_parallel

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.io.scene_file import save_scene
from tactile_localizer.scene import Axis, Phalanx, Scene

pytestmark = pytest.mark.slow

COMMITTED = Path(__file__).with_name("figures.csv")
ENGINE_BUMP = Path(__file__).parents[2] / "examples/recordings/engine_bump"
FIGURES = (
    *("error_mm", "error_settled_mm", "coverage", "coverage_contact", "within_5_mm", "within_10_mm"),
    *("converged", "false_sweeps", "false_strains", "false_before", "false_blank"),
    *("foreign_strains", "foreign_sweeps"),
)
LENGTH, PITCH, NOISE = 0.2, 0.0005, 1.5
NOISY = 10.0
"""Noise of one channel in the last row, whose weight the sweep itself has to show."""


def write_cloth(folder: Path) -> Path:
    """A cloth that is felt everywhere, slid over twice to train, and by another session to test.

    Two phalanges with eight channels feel waves of 5 to 40 mm with noise. The other session has other offsets
    and gains; its sweeps of 60 mm begin at twelve places. ``foreign_cloth`` is the same on another cloth.
    """
    folder.mkdir()
    phalanges = tuple(Phalanx(name, (0.0,)) for name in ("index", "middle"))
    save_scene(Scene("cloth", (Axis("x", 0.0, LENGTH, 0.003),), phalanges), folder / "scene.yaml")
    rng, x = np.random.default_rng(0), np.arange(0.0, LENGTH, PITCH)
    offset, gain = rng.normal(0.0, 5.0, 16), rng.uniform(0.9, 1.3, 16)
    starts = np.linspace(0, len(x) - 120, 12).astype(int)
    parts = [slice(start, start + 120) for start in starts]
    cloths = []
    for _ in range(2):
        frequency, phase = rng.uniform(150.0, 1200.0, (16, 4)), rng.uniform(0.0, 6.28, (16, 4))
        cloths.append(np.sin(x[:, None, None] * frequency + phase).sum(axis=2))
    sessions = {
        "train": [(x, cloths[0])] * 2,
        "test": [(x[part], gain * cloths[0][part] + offset) for part in parts],
        "foreign_cloth": [(x[part], gain * cloths[1][part] + offset) for part in parts],
    }
    names = ["stamp_s", "sweep", "x", *(f"{each.name}_{n}" for each in phalanges for n in range(1, 9))]
    for name, sweeps in sessions.items():
        rows = []
        for number, (at, felt) in enumerate(sweeps):
            noisy = felt + rng.normal(0.0, NOISE, felt.shape)
            rows.append(np.column_stack([0.01 * np.arange(len(at)), np.full(len(at), number), at, noisy]))
        path = folder / f"{name}.csv"
        np.savetxt(path, np.concatenate(rows), "%.6g", ",", header=",".join(names), comments="")
    return folder


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """The row of each recording that is here, by name."""
    folders = [ENGINE_BUMP, write_cloth(tmp_path_factory.mktemp("recordings") / "cloth")]
    if directory := os.environ.get("TACTILE_LOCALIZER_DATA"):
        folders.insert(0, Path(directory) / "other_hand_smooth")
    variants = [(folder, Variant()) for folder in folders] + [(ENGINE_BUMP, Variant(noisy_channel=NOISY))]
    calls = [(folder, variant, Configuration(), 1) for folder, variant in variants]
    rows = {
        row["folder"] + f"_channel_{NOISY:g}" * (row["channel"] == NOISY): row
        for own in in_parallel(measure_folder, calls, 2, "figures")
        for row in own
    }
    if "WRITE_FIGURES" in os.environ:
        write_figures(rows)
    return rows


def write_figures(rows: dict[str, dict[str, Any]]) -> None:
    with COMMITTED.open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["recording", "figure", "value", "tolerance"])
        for name in sorted(rows):
            for figure in filter(rows[name].__contains__, FIGURES):
                value, error = rows[name][figure], rows[name]["standard_errors"].get(figure, 0.0)
                table.writerow([name, figure, f"{value:.4g}", f"{max(2.0 * error, 0.01 * value):.2g}"])


@pytest.mark.parametrize("recording", ["cloth", "engine_bump", "engine_bump_channel_10", "other_hand_smooth"])
def test_figures_are_those_of_the_table(
    recording: str, measured: dict[str, dict[str, Any]], request: pytest.FixtureRequest
) -> None:
    if recording == "other_hand_smooth":
        request.getfixturevalue("data_dir")
    with COMMITTED.open(newline="") as file:
        committed = [row for row in csv.DictReader(file) if row["recording"] == recording]
    assert len(committed) >= 10
    differences = []
    for row in committed:
        found = measured[recording][row["figure"]]
        if not abs(found - float(row["value"])) <= float(row["tolerance"]):
            expected = f"{row['value']} +- {row['tolerance']}"
            differences.append(f"{row['figure']}: expected {expected}, found {found:.4g}")
    assert differences == []
