"""Files are written atomically."""

import os
from pathlib import Path

import pytest
from support.disk import full_disk

from tactile_localizer.errors import ParameterError
from tactile_localizer.io.whole_file import whole_file


def test_a_file_appears_when_complete(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "made" / "a.txt"
    on_disk: list[tuple[int, bool]] = []
    monkeypatch.setattr(os, "fsync", lambda file: on_disk.append((os.fstat(file).st_size, path.exists())))
    with whole_file(path) as unfinished:
        unfinished.write_text("all")
        assert not path.exists()
        assert unfinished.suffix == ".txt", "some writers go by it"
    assert path.read_text() == "all"
    assert on_disk == [(3, False)], "before it has its name"
    assert list(path.parent.iterdir()) == [path]


def test_a_failed_write_keeps_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("before")

    def fail_halfway() -> None:
        with whole_file(path) as unfinished:
            unfinished.write_text("half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail_halfway()
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("name", "reason"),
    [("a.txt", "File too large"), ("folder", "Is a directory"), ("file/a.txt", "File exists")],
)
def test_an_error_names_the_users_file(tmp_path: Path, name: str, reason: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    path = tmp_path / name
    with (
        pytest.raises(ParameterError, match=f"^{path}: could not be written, {reason}"),
        full_disk(100),
        whole_file(path, ParameterError) as unfinished,
    ):
        unfinished.write_text("x" * (1000 if name == "a.txt" else 10))
    assert {path.name for path in tmp_path.iterdir()} == {"folder", "file"}


def test_a_link_is_preserved(tmp_path: Path) -> None:
    (tmp_path / "real.txt").write_text("before")
    (tmp_path / "link.txt").symlink_to("real.txt")
    with whole_file(tmp_path / "link.txt") as unfinished:
        unfinished.write_text("after")
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "real.txt").read_text() == "after"
