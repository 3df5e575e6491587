"""The command `identify`."""

import numpy as np
import pytest

from tactile_localizer.cli import main
from tactile_localizer.cli.simulate import write_csv
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.scans.importer import import_recording
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.offline.identification import (
    IdentifiedSweep,
    identification_table,
    travel_table,
    verdict,
)
from tactile_localizer.resources import resource_path
from tactile_localizer.sim.scan import simulate_scan


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("identify")
    for feature in ("bump", "snap"):
        scene = load_scene(resource_path(f"config/scenes/{feature}.yaml"))
        train = simulate_scan(feature, 1, "train", rate=40.0)
        write_csv(folder / "train.csv", train, train.odometry)
        recording = read_csv(folder / "train.csv", scene)
        import_recording(recording, scene, folder / f"{feature}_scan", what="test", detail={})
    test = simulate_scan("snap", 1, "test", sweeps=2, rate=40.0)
    write_csv(folder / "test.csv", test, test.truth)
    return folder


def test_a_snap_is_distinguished_from_a_bump(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    arguments = ["identify", "test.csv", "--scan", "bump_scan", "--scan", "snap_scan", "--config", "fast"]
    assert main([*arguments, "-o", "found/picture.png"]) == 0
    output = capsys.readouterr().out
    assert "snap: 2 of 2 sweeps" in output
    assert "Mean probability along the travel" in output
    assert (folder / "found/picture.png").stat().st_size > 10_000


def test_incompatible_scans_are_refused_in_one_line(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    assert main(["identify", "test.csv", "--scan", "bump_scan", "--scan", "bump_scan"]) == 2
    assert "--scan: expected scans of different names, got bump_scan, bump_scan" in capsys.readouterr().err


def test_a_sweep_is_settled_after_the_last_change():
    probabilities = np.array([[0.5, 0.3, 0.2], [0.2, 0.6, 0.2], [0.5, 0.3, 0.2], [0.8, 0.1, 0.1]])
    sweep = IdentifiedSweep(3, ("a", "b", "none of them"), np.array([0.0, 0.01, 0.02, 0.03]), probabilities)
    assert (sweep.identified, sweep.settled_m) == ("a", 0.02)
    assert verdict([sweep]) == "a: 1 of 1 sweeps"
    assert travel_table([sweep]).rows[2] == ("10", "1", "0.200", "0.600", "0.200")
    assert identification_table([sweep]).rows[0] == (
        "3", "30.0", "0.800", "0.100", "0.100", "a", "20.0",
    )  # fmt: skip
