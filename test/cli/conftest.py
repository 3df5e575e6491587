"""Fixtures of the commands that import recordings."""

import math

import pytest
from support.bags import SCENE
from support.imports import LINE
from support.learned import unexamined, unlearned

from tactile_localizer.cli import main, progress
from tactile_localizer.io.scene_file import save_scene


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_scene(SCENE, tmp_path / "scene.yaml")
    save_scene(LINE, tmp_path / "line.yaml")
    return tmp_path


@pytest.fixture
def run(folder, capsys, monkeypatch):
    """Function that runs an import; returns its status and what it printed, without progress."""
    monkeypatch.setattr(progress, "LINE_EVERY_S", math.inf)  # on a busy machine there would be lines of it
    monkeypatch.setattr("tactile_localizer.cli.import_.learn_and_keep", unlearned)
    monkeypatch.setattr("tactile_localizer.io.scans.learned.learn_model", unexamined)

    def call(arguments, *more):
        status = main(["import", *arguments.split(), *more])
        printed = capsys.readouterr()
        assert printed.err.count("\n") == (status != 0), "one line"
        return status, printed.out, printed.err

    return call
