"""Requested paths cannot leave the directory chosen by the operator."""

import pytest

from tactile_localizer.errors import ScanError
from tactile_localizer.io.confinement import confined


@pytest.fixture
def directory(tmp_path):
    (tmp_path / "scans" / "old").mkdir(parents=True)
    (tmp_path / "scans" / "a_scan").touch()
    (tmp_path / "secret_scan").touch()
    return tmp_path / "scans"


@pytest.mark.parametrize("path", ["a_scan", "old/b_scan", "./a_scan", "old/../a_scan"])
def test_a_path_in_the_directory_is_accepted(directory, path):
    assert confined(path, str(directory)) == (directory / path).resolve()


def test_an_absolute_path_in_the_directory_is_accepted(directory):
    assert confined(str(directory / "a_scan"), str(directory)) == directory / "a_scan"


@pytest.mark.parametrize(
    "path", ["../secret_scan", "/etc/passwd", "old/../../secret_scan", "..", ".", "", "~/x", "a\0b"]
)
def test_a_path_out_of_the_directory_is_refused(directory, path):
    if path == "~/x":
        assert confined(path, str(directory)) == directory / "~" / "x", "no shell, no home"
        return
    with pytest.raises(ScanError, match="expected a path in"):
        confined(path, str(directory))


def test_a_link_out_of_the_directory_is_refused(directory):
    (directory / "link_scan").symlink_to(directory.parent / "secret_scan")
    (directory / "up").symlink_to(directory.parent)
    for path in ("link_scan", "up/secret_scan"):
        with pytest.raises(ScanError, match="expected a path in"):
            confined(path, str(directory))


def test_a_directory_with_a_common_prefix_is_refused(directory):
    (directory.parent / "scans2").mkdir()
    with pytest.raises(ScanError, match="expected a path in"):
        confined("../scans2/a_scan", str(directory))


def test_without_a_directory_all_paths_are_refused():
    with pytest.raises(ScanError, match="scan_directory: expected a directory"):
        confined("a_scan", "")
