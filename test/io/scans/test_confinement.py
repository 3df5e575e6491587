"""Requested paths cannot leave the directory chosen by the operator."""

import pytest

from tactile_localizer.errors import ScanError
from tactile_localizer.io.scans.folder import confined


@pytest.fixture
def directory(tmp_path):
    (tmp_path / "scans" / "old").mkdir(parents=True)
    (tmp_path / "scans" / "a_scan").touch()
    (tmp_path / "secret_scan").touch()
    return tmp_path / "scans"


@pytest.mark.parametrize("path", ["a_scan", "old/b_scan", "./a_scan", "old/../a_scan", "~/x"])
def test_a_path_in_the_directory_is_accepted(directory, path):
    assert confined(path, str(directory)) == directory.resolve() / path.replace("old/../", "")
    assert confined(str(directory / path), str(directory)) == (directory / path).resolve()


OUTSIDE = ["../secret_scan", "/etc/passwd", "old/../../secret_scan", "..", ".", "", "a\0b", "../scans2/a"]


@pytest.mark.parametrize("path", OUTSIDE)
def test_a_path_out_of_the_directory_is_refused(directory, path):
    with pytest.raises(ScanError, match="expected a path in"):
        confined(path, str(directory))
    with pytest.raises(ScanError, match="scan_directory: expected a directory"):
        confined(path, "")


def test_a_link_out_of_the_directory_is_refused(directory):
    (directory / "link_scan").symlink_to(directory.parent / "secret_scan")
    (directory / "up").symlink_to(directory.parent)
    for path in ("link_scan", "up/secret_scan"):
        with pytest.raises(ScanError, match="expected a path in"):
            confined(path, str(directory))
