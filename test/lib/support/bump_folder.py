"""Fixtures of a folder with a scan of the simulated bump and test sweeps, as the command line makes them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

TUNED = {"position_std": 0.003, "strain_std": 0.03, "correlation_length": 0.003}
"""Parameters of the kernel models, so that none are chosen from the scan."""


def write_bump_files(folder: Path, *options: str) -> Path:
    """Write ``scene.yaml``, ``train.csv``, ``test.csv`` (two sweeps) and ``bump_scan``; returns the folder.

    ``options`` are those of ``tactile-localizer simulate``.
    """
    # numpy must not be imported before conftest has limited the threads of BLAS.
    from tactile_localizer.cli import main
    from tactile_localizer.io.scene_file import load_scene, save_scene
    from tactile_localizer.resources import resource_path

    scene = replace(load_scene(resource_path("config/scenes/bump.yaml")), measurement=TUNED)
    save_scene(scene, folder / "scene.yaml")
    assert main(["simulate", "bump", "-o", str(folder), "--test", "2", *options]) == 0
    files = [
        str(folder / "train.csv"),
        "--scene",
        str(folder / "scene.yaml"),
        "-o",
        str(folder / "bump_scan"),
    ]
    assert main(["import", "csv", *files]) == 0
    return folder


@pytest.fixture(scope="module")
def bump_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of :func:`write_bump_files` with few training sweeps."""
    return write_bump_files(tmp_path_factory.mktemp("bump"), "--train", "5")


@pytest.fixture
def bump_folder(bump_files: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder :func:`bump_files` as working directory."""
    monkeypatch.chdir(bump_files)
    return bump_files
