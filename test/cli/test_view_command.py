"""The command `view`."""

import subprocess
import sys
from unittest import mock

import pytest

from tactile_localizer.cli import main, view
from tactile_localizer.cli.simulate import write_csv
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.scans.importer import import_recording
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.resources import resource_path
from tactile_localizer.sim.scan import simulate_scan


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("view")
    scene = load_scene(resource_path("config/scenes/bump.yaml"))
    train, test = simulate_scan("bump", 1, "train"), simulate_scan("bump", 1, "test", sweeps=1)
    write_csv(folder / "train.csv", train, train.odometry)
    write_csv(folder / "test.csv", test, test.truth)
    import_recording(
        read_csv(folder / "train.csv", scene), scene, folder / "bump_scan", what="test", detail={}
    )
    return folder


def test_a_view_is_saved_with_belief_truth_strains_and_reason(folder, monkeypatch, capsys):
    pytest.importorskip("rerun")
    monkeypatch.chdir(folder)
    assert main(["view", "test.csv", "--scan", "bump_scan", "--config", "fast", "--save", "a/b.rrd"]) == 0
    assert "1 sweeps, " in capsys.readouterr().out
    listed = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "print", "a/b.rrd"],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    entities = listed.stdout + listed.stderr
    for entity in ("material/map", "material/belief", "material/truth", "strain/index", "reason"):
        assert f"/{entity}" in entities


def test_a_missing_viewer_is_named_in_one_line(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert main(["view", "test.csv", "--scan", "bump_scan", "--save", "a.rrd"]) == 2
    printed = capsys.readouterr().err
    assert "rerun-sdk" in printed
    assert printed.count("\n") == 1


def test_without_a_display_the_viewer_is_refused_in_one_line(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert main(["view", "test.csv", "--scan", "bump_scan"]) == 2
    printed = capsys.readouterr().err
    assert "viewer: expected a display" in printed
    assert printed.count("\n") == 1


def test_the_viewer_serves_this_machine_only(folder, monkeypatch):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("DISPLAY", ":0")
    commands = []
    monkeypatch.setattr(view, "_write", lambda args, path: None)
    monkeypatch.setattr(
        subprocess, "run", lambda command, **_: commands.append(command) or mock.Mock(returncode=0)
    )
    assert main(["view", "test.csv", "--scan", "bump_scan"]) == 0
    assert commands[0][3:5] == ["--bind", "127.0.0.1"]
