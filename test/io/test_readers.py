"""The suffix of a recording decides which reader it has."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from support.bags import SCENE

from tactile_localizer.cli import main
from tactile_localizer.errors import ScanError
from tactile_localizer.io.readers import GROUP, importable, reader_of
from tactile_localizer.plugins import installed

ENTRIES = "\n".join(
    [
        f"[{GROUP}]",
        *(f"{name} = skin:read" for name in (".dat", ".skin.csv", "Zarr", ".bag", "wav", ".WAV", "50%")),
    ]
)


@pytest.fixture
def with_another_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A package that is installed for the test."""
    metadata = tmp_path / "site/skin-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: skin\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(ENTRIES)
    monkeypatch.syspath_prepend(metadata.parent)
    installed.cache_clear()
    yield
    installed.cache_clear()


def made(path: Path) -> Path:
    """An empty file, with the folders that it is in."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    return path


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("test.csv", "csv"),
        ("TEST.CSV", "csv"),
        ("test.csv.gz", "csv"),
        ("test.dat", "csv"),
        ("test", "csv"),
        ("run_0.5mm", "csv"),
        ("run.2026-11-28", "csv"),
        ("sweep.log", "can"),
        ("sweep.log.gz", "can"),
        ("sweep.BLF", "can"),
        ("bag.db3", "bag"),
        ("bag.mcap.zstd", "bag"),
    ],
)
def test_a_file_has_the_reader_of_its_suffix(tmp_path: Path, name: str, kind: str) -> None:
    assert reader_of(made(tmp_path / name)).kind == kind


@pytest.mark.parametrize("name", ["bag", "run.1", "bag.csv"])
def test_a_folder_is_a_scan_or_a_bag(tmp_path: Path, name: str) -> None:
    made(tmp_path / name / "metadata.yaml")
    assert reader_of(tmp_path / name).kind == "bag"
    made(tmp_path / name / "scene.yaml")
    assert reader_of(tmp_path / name).kind == "scan"


def test_an_unknown_suffix_is_refused_with_those_that_there_are(tmp_path: Path) -> None:
    with pytest.raises(
        ScanError, match=r"a\.foo: expected a folder, or a file of \.asc, .*\.tsv.* found \.foo"
    ):
        reader_of(made(tmp_path / "a.foo"))
    assert reader_of(tmp_path / "none.foo").kind == "csv", "which reports that there is no such file"


@pytest.mark.usefixtures("with_another_package")
def test_a_suffix_of_another_package_replaces_ours_and_the_longest_is_taken(tmp_path: Path) -> None:
    assert reader_of(made(tmp_path / "a.dat")).kind == "dat"
    assert reader_of(made(tmp_path / "a.skin.csv")).kind == "skin.csv"
    assert reader_of(made(tmp_path / "a.csv")).kind == "csv"
    assert reader_of(made(tmp_path / "store.zarr/0").parent).kind == "zarr", "of a folder, too"
    assert {*importable()} == {"bag", "can", "csv", "dat", "skin.csv", "zarr", ".bag", "wav", "50%"}


@pytest.mark.usefixtures("with_another_package")
def test_a_reader_in_place_of_ours_is_another_kind_which_has_no_options_of_ours(tmp_path: Path) -> None:
    reader = reader_of(made(tmp_path / "a.bag"))
    assert reader.kind == ".bag"
    with pytest.raises(ScanError, match=r"a\.bag: reader skin:read of skin: .*No module named 'skin'"):
        reader.read(tmp_path / "a.bag", SCENE)


@pytest.mark.usefixtures("with_another_package")
@pytest.mark.parametrize("kind", [[], ["50%"]])
def test_help_names_any_suffix(kind: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        main(["import", *kind, "--help"])
    assert ".50% files" in capsys.readouterr().out


@pytest.mark.usefixtures("with_another_package")
def test_one_suffix_in_two_spellings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ScanError, match=r"readers wav: expected one .* has it, found skin, skin"):
        reader_of(made(tmp_path / "a.wav")).read(tmp_path / "a.wav", SCENE)
