"""Figures of localization stay what they are: `benchmarks/recorded.py` on recordings and small sheets.

`figures.csv` has each figure of each sweep. What is found now is compared sweep by sweep: the mean difference
has to be within two of its standard errors, or 1 % of the figure. After a change that is meant to alter
figures, write them anew and look at the difference:

    WRITE_FIGURES=1 scripts/in_env python -m pytest test/regression
"""

import csv
import os
from collections.abc import Callable
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded import Variant, measure_folder
from support.learned import learn_once

from tactile_localizer.core.configuration import Configuration
from tactile_localizer.io.scene_file import save_scene
from tactile_localizer.scene import Axis, Phalanx, Scene

pytestmark = pytest.mark.slow

COMMITTED = Path(__file__).with_name("figures.csv")
ENGINE_BUMP = Path(__file__).parents[2] / "examples/recordings/engine_bump"
FIGURES = (
    *("error_mm", "error_settled_mm", "coverage", "coverage_contact", "within_5_mm", "within_10_mm"),
    *("converged", "again", "set_down", "false_sweeps", "false_strains", "false_before", "false_blank"),
    *("foreign_strains", "foreign_sweeps"),
)
NOISY = 10.0
"""Noise of one channel in a row of its own, whose weight the sweep itself has to show."""
FEW_FIGURES = (
    *("error_mm", "within_10_mm", "converged", "again", "set_down"),
    *("false_sweeps", "false_before", "false_blank"),
)
IN_FULL = ("cloth", "engine_bump", f"engine_bump_channel_{NOISY:g}", "other_hand_smooth")
"""Recordings of which all figures are kept, where of the others only :data:`FEW_FIGURES` are."""
LINES = {"materials_hem": 2, "materials_zipper_beyond": 1, "other_hand_smooth": 1, "taxels_patch": 2}
"""Recordings of ``TACTILE_LOCALIZER_DATA``: every so many-th line is learned, as all take thrice as long."""
LENGTH, PITCH, NOISE = 0.1, 0.0005, 1.5


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


def write_sheet(folder: Path, channels: int, height: float, noise: float, slope: float) -> Path:
    """A sheet of 40 x 24 mm with a ridge across x, ``height`` V high, and white noise of ``noise`` V.

    Along the ridge the strain changes by ``slope`` rad per mm: with 0 it is a seam, along which no place
    differs. Six training sweeps are 4 mm apart; the test sweeps are between them, the blank ones feel
    nothing.
    """
    folder.mkdir()
    phalanges = tuple(Phalanx(name, (0.0, 0.0), channels) for name in ("index", "thumb"))
    axes = (Axis("x", 0.0, 0.04, 0.003), Axis("y", 0.0, 0.024, 0.003))
    save_scene(Scene(folder.name, axes, phalanges), folder / "scene.yaml")
    rng, x, count = np.random.default_rng(0), np.arange(0.0, 0.04, PITCH), 2 * channels
    phase = np.linspace(0.0, 3.0, count)
    gauges = [f"{each.name}_{n + 1}" for each in phalanges for n in range(channels)]
    names = ["stamp_s", "sweep", "felt", "x", "y", *gauges]
    for name, lines in (
        ("train", np.arange(0.002, 0.024, 0.004)),
        ("test", np.linspace(0.005, 0.019, 8)),
        ("blank", np.array([0.004, 0.012, 0.02])),
    ):
        rows = []
        for number, y in enumerate(lines):
            ridge = height * (name != "blank") * np.exp(-0.5 * ((x - 0.02) / 0.003) ** 2)
            felt = ridge[:, None] * np.sin(1e3 * slope * (y - 0.012) + phase)
            noisy = felt + noise * rng.standard_normal(felt.shape)
            sweep, touched = np.full(len(x), number), np.abs(ridge) > 0.02 * height
            at = np.column_stack([0.01 * np.arange(len(x)), sweep, touched, x, np.full(len(x), y)])
            rows.append(np.hstack([at, noisy]))
        path = folder / f"{name}.csv"
        np.savetxt(path, np.concatenate(rows), "%.7g", ",", header=",".join(names), comments="")
    return folder


def write_pressed(folder: Path) -> Path:
    """A material that is felt everywhere, scanned at one force, and pressed by 20 % more or less in use.

    A phalanx with twelve channels feels waves of 18 mm and more on 40 x 20 mm, with noise. In use the force
    changes along a sweep over 6 mm.
    """
    folder.mkdir()
    axes = (Axis("x", 0.0, 0.04, 0.003), Axis("y", 0.0, 0.02, 0.003))
    save_scene(Scene("pressed", axes, (Phalanx("skin", (0.0, 0.0), 12),)), folder / "scene.yaml")
    rng, x = np.random.default_rng(0), np.arange(0.0, 0.04, PITCH)
    waves, phases = rng.standard_normal((200, 2)) / 0.009, rng.uniform(0.0, 2.0 * np.pi, 200)
    heights = rng.standard_normal((200, 12)) * np.sqrt(2.0 / 200)
    names = ["stamp_s", "sweep", "x", "y", *(f"skin_{n}" for n in range(1, 13))]
    for name, lines in (("train", np.arange(0.0, 0.0201, 0.002)), ("test", np.linspace(0.003, 0.017, 12))):
        rows = []
        for number, y in enumerate(lines):
            at, force = np.column_stack([x, np.full(len(x), y)]), np.zeros(len(x))
            if name == "test":
                kept = np.exp(-PITCH / 0.006)
                for row, step in enumerate(rng.standard_normal(len(x) - 1), 1):
                    force[row] = kept * force[row - 1] + 0.2 * np.sqrt(1.0 - kept**2) * step
            felt = (1.0 + force)[:, None] * (np.cos(at @ waves.T + phases) @ heights)
            noisy = felt + 0.05 * rng.standard_normal(felt.shape)
            rows.append(np.column_stack([0.01 * np.arange(len(x)), np.full(len(x), number), at, noisy]))
        path = folder / f"{name}.csv"
        np.savetxt(path, np.concatenate(rows), "%.7g", ",", header=",".join(names), comments="")
    return folder


MADE: dict[str, Callable[[Path], Path]] = {
    "channels_32": partial(write_sheet, channels=32, height=10.0, noise=1.0, slope=0.15),
    "cloth": write_cloth,
    "pressed": write_pressed,
    "quiet": partial(write_sheet, channels=8, height=1.0, noise=0.002, slope=0.15),
    "seam": partial(write_sheet, channels=8, height=10.0, noise=1.0, slope=0.0),
}
"""Functions that write a recording to a folder of its name."""


@pytest.fixture
def measured(
    recording: str, tmp_path: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> dict[str, Any]:
    """The row of a recording."""
    monkeypatch.setattr("recorded.learn", learn_once)
    if recording in MADE:
        folder = MADE[recording](tmp_path / recording)
    elif recording in LINES:
        folder = request.getfixturevalue("data_dir") / recording
    else:
        folder = ENGINE_BUMP
    noise = NOISY if recording.endswith(f"_channel_{NOISY:g}") else 0.0
    variant = Variant(lines=LINES.get(recording, 1), noisy_channel=noise)
    (row,) = measure_folder(folder, variant, Configuration(), 1)
    if "WRITE_FIGURES" in os.environ:
        write_figures(recording, row)
    return row


def write_figures(recording: str, row: dict[str, Any]) -> None:
    """Replace the figures of a recording in the table."""
    kept = [each for each in committed() if each["recording"] != recording]
    for figure in filter(row.__contains__, FIGURES if recording in IN_FULL else FEW_FIGURES):
        values = " ".join(f"{value:.4g}" for value in values_of(row, figure))
        kept.append({"recording": recording, "figure": figure, "values": values})
    with COMMITTED.open("w", newline="") as file:
        table = csv.DictWriter(file, ["recording", "figure", "values"], lineterminator="\n")
        table.writeheader()
        table.writerows(sorted(kept, key=itemgetter("recording")))


def committed() -> list[dict[str, str]]:
    """The rows of the table."""
    with COMMITTED.open(newline="") as file:
        return list(csv.DictReader(file))


def values_of(row: dict[str, Any], figure: str) -> list[float]:
    """A figure of each sweep, or that of all where it is a count."""
    return row["by_sweep"].get(figure, [row[figure]])


def differs(before: np.ndarray, now: np.ndarray) -> bool:
    """Whether a figure of n sweeps changed by more than the sweeps differ in their change."""
    if before.shape != now.shape or (np.isfinite(before) != np.isfinite(now)).any():
        return True
    change = (now - before)[np.isfinite(before)]
    error = change.std(ddof=1) / np.sqrt(len(change)) if len(change) > 1 else 0.0
    return bool(abs(change.mean()) > max(2.0 * error, 0.01 * abs(before[np.isfinite(before)].mean())))


# In this order no worker waits for what another one learns from the same scan.
@pytest.mark.parametrize("recording", ["engine_bump", *LINES, *MADE, f"engine_bump_channel_{NOISY:g}"])
def test_figures_are_those_of_the_table(recording: str, measured: dict[str, Any]) -> None:
    rows = [row for row in committed() if row["recording"] == recording]
    assert len(rows) >= (10 if recording in IN_FULL else 4)
    differences = []
    for row in rows:
        before = np.array(row["values"].split(), dtype=float)
        now = np.array(values_of(measured, row["figure"]))
        if differs(before, now):
            differences.append(
                f"{row['figure']}: expected {before.mean():.4g}, found {now.mean():.4g}: {now}"
            )
    assert differences == []


def test_a_small_change_of_every_sweep_is_a_difference_and_a_large_one_of_a_few_is_none() -> None:
    before, rng = np.linspace(1.0, 6.0, 18), np.random.default_rng(0)
    assert differs(before, before + 0.1)
    assert not differs(before, before + 0.02)
    assert not differs(before, before + rng.standard_normal(18))
