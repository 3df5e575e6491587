"""The command `tune`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.sweeps import scene_of

from tactile_localizer.cli import main
from tactile_localizer.core.calibration.sweep_model import learn_sweep_model
from tactile_localizer.core.parameters import ModelParameters
from tactile_localizer.io.scans import learned
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.offline.reports.learned import noise_table, widths_table
from tactile_localizer.sim import simulate_scan


def test_noise_is_smaller_than_the_strain_on_each_phalanx() -> None:
    scene = scene_of()
    table = noise_table(scene, learn_sweep_model(simulate_scan("bump", 1, rate=20.0).to_scan(), scene), "mV")
    assert "noise, mV" in table.columns
    assert [row[0] for row in table.rows] == list(scene.phalanx_names)
    for _, channels, noise, noisiest, _, strain in table.rows:
        assert channels == "8"
        assert 0.0 < float(noise) <= float(noisiest)
        assert float(noise) < 0.5 * float(strain)


def test_widths_have_units() -> None:
    rows = widths_table(scene_of(), ModelParameters(0.002, 0.03), "V").rows
    assert rows[0] == ("position, x", "x 2.00 mm")
    assert rows[-1] == ("strain, middle", "0.03 V")


@pytest.fixture
def linen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, data_dir: Path) -> Path:
    monkeypatch.chdir(tmp_path)
    files = [f"{repeat}.csv" for repeat in range(2)]
    for repeat, file in enumerate(files):
        whole = data_dir / "fabric_slide" / f"Linen_F250_V10mmps_{repeat}.csv"
        Path(file).write_text("".join(whole.read_text().splitlines(keepends=True)[:110]))  # 30 mm
    reading = ["--columns", "fabric_slide.yaml", "--speed", "0.01", "--scene", "linen.yaml"]
    assert main(["import", "csv", *files, *reading, "-o", "bump_scan"]) == 0
    return tmp_path


def test_learned_values_are_printed_and_stored(
    linen: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["tune", "--scan", "bump_scan"]) == 0
    printed = capsys.readouterr().out
    for expected in ("material", "information length", "presence length", "registration", " mm"):
        assert expected in printed
    monkeypatch.setattr(learned, "learn", None)  # not learned again
    assert main(["replay", "bump_scan", "--scan", "bump_scan", "--starts", "1", "--travel", "0.02"]) == 0


def test_a_scene_for_the_kernel_models_has_widths_and_neighbours(
    linen: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["tune", "--scan", "bump_scan", "-o", "tuned.yaml"]) == 0
    printed = capsys.readouterr().out
    assert "Kernel widths" in printed
    assert "Neighbours" in printed
    tuned = load_scene("tuned.yaml").measurement
    assert np.size(tuned["position_std"]) == 1
    assert len(tuned["strain_std"]) == 16
    assert tuned["neighbours"] >= 2
