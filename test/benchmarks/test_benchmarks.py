"""Each benchmark runs on one sweep, and its measures are what its docstring says."""

import json
import runpy
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from compiled_filter import COMPILER
from recorded import white_noise_std, with_white_noise
from speed import cost
from support.sweeps import CALIBRATION, write_scan

from tactile_localizer.cli.simulate import write_csv
from tactile_localizer.io.recording import RecordedSweep, Recording
from tactile_localizer.io.scene_file import save_scene
from tactile_localizer.sim import shipped_scene, simulate_recording

ROOT = Path(__file__).parents[2]


@pytest.fixture
def learned(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was learned from the bump before: learning takes most of a benchmark's time."""
    for module in ("tactile_localizer.core.factory", "recorded"):
        monkeypatch.setattr(f"{module}.learn", lambda *_: CALIBRATION)


def run(script: str, *arguments: str | Path) -> None:
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(sys, "argv", [script, *map(str, arguments)])
        runpy.run_path(str(ROOT / "benchmarks" / script), run_name="__main__")


def rows_of(folder: Path, script: str, *arguments: str | Path) -> list[dict[str, Any]]:
    """Rows that a benchmark writes."""
    run(script, *arguments, "--json", folder / "rows.json")
    return json.loads((folder / "rows.json").read_text())["rows"]


def write_fabric(folder: Path, name: str, material: int, repeats: int) -> None:
    """A smooth random material of 100 mm, sampled each millimetre; repeats differ by white noise."""
    x = np.arange(0.0, 101.0)
    phase = 2 * np.pi * x[:, None] / np.geomspace(6.0, 200.0, 40)
    waves = np.random.default_rng(material).normal(size=(16, 40, 2))
    felt = 5 * np.einsum("cwk,kxw->xc", waves, np.stack([np.sin(phase), np.cos(phase)]))
    header = ",".join(["timestamp", "proximity1", "proximity2", *(f"channel{n}" for n in range(1, 17))])
    for repeat in range(repeats):
        noise = np.random.default_rng([material, repeat]).normal(size=felt.shape)
        rows = np.column_stack([1000 + 20 * x, 0 * x, 0 * x, felt + noise]).round()
        path = folder / f"{name}_V50mmps_{repeat}.csv"
        np.savetxt(path, rows, "%d", ",", header=header, comments="")


@pytest.fixture(scope="module")
def bump(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of recordings of the bump."""
    folder = tmp_path_factory.mktemp("bump")
    scene = shipped_scene("bump")
    save_scene(scene, folder / "scene.yaml")
    for kind, options in (("train", {"rate": 10.0}), ("test", {"sweeps": 1})):
        write_csv(folder / f"{kind}.csv", simulate_recording("bump", 1, kind, **options), scene, "truth")
    return folder


def test_recorded_has_a_row_for_a_folder(bump: Path, tmp_path: Path, learned: None) -> None:
    (row,) = rows_of(tmp_path, "recorded.py", bump, "--lines", "2", "--jobs", "1")
    assert row["error_settled_mm"] < 5.0
    assert (row["false_before"], row["lines"]) == (0, 2)
    assert not {"false_blank", "foreign_strains"} & row.keys()


def test_recorded_adds_white_noise_in_units_of_the_channels_own() -> None:
    rng, slow = np.random.default_rng(0), np.sin(np.linspace(0.0, 9.0, 4000))[:, None]
    std = np.array([0.1, 3.0])
    noisy = [slow + std * rng.standard_normal((4000, 2)) for _ in range(3)]
    sweeps = tuple(
        RecordedSweep(n, np.arange(4000), slow, strain, np.zeros((4000, 1))) for n, strain in enumerate(noisy)
    )
    recording = Recording("waves", sweeps)
    np.testing.assert_allclose(white_noise_std(recording), std, rtol=0.05)
    assert with_white_noise(recording, 0.0 * std, rng).sweeps[0].strain.tolist() == noisy[0].tolist()
    louder = with_white_noise(recording, np.sqrt(2.0**2 - 1.0) * std, rng)
    np.testing.assert_allclose(white_noise_std(louder), 2.0 * std, rtol=0.05)


def test_speed_measures_what_a_user_waits_for(bump: Path, tmp_path: Path) -> None:
    for name in ("scene.yaml", "test.csv"):
        (tmp_path / name).symlink_to(bump / name)
    one_sweep = simulate_recording("bump", 1, sweeps=1, rate=10.0)
    write_csv(tmp_path / "train.csv", one_sweep, shipped_scene("bump"), "truth")
    rows = rows_of(tmp_path, "speed.py", tmp_path, "--repeat", "1", "--cycles", "10")
    values = {row["name"]: row["value"] for row in rows}
    assert values["import of the package"] > 0.0
    assert values["first estimate"] > 0.0
    assert values["learning and replay"] > 0.0
    assert values["import, learning and replay"] == values["import csv"] + values["learning and replay"]
    assert values["decoding"] > 0.0
    if shutil.which(COMPILER):
        assert values["update of 1000 particles, C++"] > 0.0


def test_speed_measures_the_tree_beside(tmp_path: Path) -> None:
    for name in ("own", "beside"):
        package = tmp_path / name / "tactile_localizer"
        package.mkdir(parents=True)
        (package / "__init__.py").write_text("open('imported', 'w')")
    cost(tmp_path / "beside", "import tactile_localizer")
    assert [path.parent.name for path in tmp_path.glob("*/imported")] == ["beside"]


@pytest.mark.skipif(not shutil.which(COMPILER), reason="no C++ compiler")
def test_the_filter_in_cpp_finds_the_place(
    bump: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_scan(tmp_path / "scan")
    capsys.readouterr()
    run("compiled_filter.py", tmp_path / "scan", bump / "test.csv", "--particles", "1000")
    taken, error = map(float, capsys.readouterr().out.split())
    assert taken > 0.0
    assert error < 0.0075


def test_forces_has_a_row_for_each_force(tmp_path: Path) -> None:
    arguments = ("--seeds", "3", "--lengths", "18", "--offsets", "0", "--sweeps", "1", "--jobs", "1")
    rows = rows_of(tmp_path, "forces.py", *arguments)
    assert [row["force"] for row in rows] == ["grasp", "same", "trembles", "wanders"]
    assert all(row["right"] + row["wrong"] + row["lost"] + row["never"] == 1 for row in rows)
    assert sum(row["right"] for row in rows) >= 3


def test_delays_are_found_of_strokes_there_and_back(bump: Path, tmp_path: Path) -> None:
    arguments = ("--delays", "0", ".1", "--errors", "--orders", "0", "3", "--jobs", "1")
    rows = rows_of(tmp_path, "delays.py", bump, *arguments)
    assert [(row["order"], row["delay_ms"], row["corrected"]) for row in rows] == [
        (order, delay_ms, int(delay_ms > 0)) for order in (0, 3) for delay_ms in (0, 100)
    ]
    assert max(abs(row["found_less_ms"]) for row in rows) < 10.0


def test_features_has_a_row_for_each_threshold(tmp_path: Path, learned: None) -> None:
    chosen = ["--seeds", "80", "--features", "bump", "--sweeps", "1", "--jobs", "1"]
    plot = tmp_path / "convergence.png"
    rows = rows_of(tmp_path, "features.py", *chosen, "--probabilities", "0.9", "0.99", "--plot", plot)
    assert [row["probability"] for row in rows] == [0.9, 0.99]
    assert rows[0]["error_mm"] == rows[1]["error_mm"] < 10.0
    assert plot.stat().st_size > 10_000


def test_paper_draws_its_figures(tmp_path: Path, learned: None) -> None:
    chosen = ["--features", "bump", "--seeds", "1", "--sweeps", "1", "--jobs", "1"]
    run("paper.py", *chosen, "--out", tmp_path)
    assert (tmp_path / "bump.png").stat().st_size > 10_000


def test_fabrics_has_a_row_for_every_pair(tmp_path: Path) -> None:
    write_fabric(tmp_path, "Linen_F250", material=1, repeats=3)
    write_fabric(tmp_path, "Silk_F250", material=2, repeats=1)
    own, wrong = rows_of(tmp_path, "fabrics.py", tmp_path, "--starts", "2", "--jobs", "1")
    assert (own["map"], own["recording"], own["kind"]) == ("Linen_F250_V50", "Linen_F250_V50", "own")
    assert (wrong["recording"], wrong["kind"]) == ("Silk_F250_V50", "wrong")
    assert own["found"] == 1.0
    assert wrong["found"] is None
