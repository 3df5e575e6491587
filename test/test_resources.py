"""Shipped files are found wherever the package is installed."""

from pathlib import Path

import pytest

from tactile_localizer import resources
from tactile_localizer.resources import resource_path

ROOT = Path(__file__).parents[1]


@pytest.fixture
def nowhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An installed package without data files, and without ROS."""
    package = tmp_path / "site-packages" / "tactile_localizer"
    package.mkdir(parents=True)
    monkeypatch.setattr(resources, "PACKAGE", package)
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    return package


def write(path: Path) -> Path:
    path.parent.mkdir(parents=True)
    path.write_text("found")
    return path


def test_files_are_found_in_a_ros_workspace(
    nowhere: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shared = write(tmp_path / "install/share/tactile_localizer/config/loadcells.dbc")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nonexistent:{tmp_path / 'install'}")
    assert resource_path("config/loadcells.dbc") == shared


def test_a_missing_file_is_named_with_the_searched_folders(nowhere: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"config/none\.yaml: expected in one of .*site-packages"):
        resource_path("config/none.yaml")
