"""The command ``tradeoff``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tactile_localizer.cli import main


@pytest.mark.slow
def test_configurations_are_compared_on_several_recordings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", "bump", "--train", "11", "--test", "1", "-o", "."]) == 0
    assert main(["import", "csv", "train.csv", "--scene", "bump.yaml", "-o", "bump_scan"]) == 0
    Path("own.yaml").write_text("cell: 1.0\nupdate_distance: 0.003\n")
    Path("again.csv").write_bytes(Path("test.csv").read_bytes())
    command = "tradeoff test.csv again.csv --scan bump_scan --configurations own.yaml fast"
    assert main([*command.split(), "--budget-us", "1e6"]) == 0
    assert "again.csv" in capsys.readouterr().out
    document = json.loads(Path("tradeoff/tradeoff.json").read_text())
    assert [one["name"] for one in document["candidates"]] == ["own", "fast"]
    assert document["candidates"][0]["error_of_recording_m"].keys() == {"test.csv", "again.csv"}
    assert Path("tradeoff/tradeoff.png").stat().st_size > 10_000
    assert main(["replay", "test.csv", "--scan", "bump_scan", "--config", "tradeoff/configuration.yaml"]) == 0
    assert main([*command.split(), "--target-mm", "1e-9"]) == 1
    assert "none; nearest is" in capsys.readouterr().out
