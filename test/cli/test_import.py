"""`import` makes scan files of recordings and says what it left out."""

import csv

import numpy as np
import pytest
from support.bags import SCENE, slide, write_bag

from tactile_localizer.cli import main
from tactile_localizer.io.scan_store import ScanStore
from tactile_localizer.io.scene_file import save_scene

HEADER = ["stamp_s", "sweep", "x", "y", *(f"{p}_{g}" for p in ("index", "middle") for g in range(1, 9))]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_scene(SCENE, tmp_path / "scene.yaml")
    return tmp_path


def write_csv(path, rows):
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([HEADER, *rows])


def test_a_csv_of_standard_columns_becomes_a_scan_file(folder, capsys):
    rng = np.random.default_rng(0)
    rows = [[0.01 * n, n // 50, 0.0004 * n, 0.02, *rng.normal(size=16)] for n in range(200)]
    rows[7][5] = "broken"
    write_csv(folder / "train.csv", rows)
    assert main(["import", "csv", "train.csv", "--scene", "scene.yaml", "-o", "scan.db"]) == 0
    output = capsys.readouterr().out.splitlines()
    assert output == [
        "scan.db: 3 sweeps, 125 pairs",
        "  train.csv: left out 1 of 200 rows: 1 not numbers (first: line 9, index_2 'broken')",
        "  left out 74 of 199 samples with a palm position outside the scene's bounds"
        " (x is 0 to 0.0796, bounds 0 to 0.05)",
        "  left out 1 of 4 sweeps whole: 3",
    ]
    with ScanStore.open("scan.db") as store:
        assert [sweep.number for sweep in store.sweeps()] == [0, 1, 2]
        assert store.scene == SCENE
        ((_, what, detail),) = store.history()
        assert (what, detail["files"]) == ("import csv", ["train.csv"])


def test_the_shipped_fabric_scenes_and_naming_are_found_by_name(folder, capsys):
    columns = ["timestamp", "proximity1", *(f"channel{n}" for n in range(1, 17))]
    for repeat in (0, 1):
        with (folder / f"{repeat}.csv").open("w") as file:
            file.write(", ".join(columns) + "\n")
            for row in range(30):
                file.write(",".join(map(str, [443069 + 28 * row, 7, *range(row, row + 16)])) + "\n")
    arguments = "0.csv 1.csv --scene linen.yaml --columns fabric_slide.yaml --speed 0.01 -o linen.db"
    assert main(["import", "csv", *arguments.split()]) == 0
    assert capsys.readouterr().out == "linen.db: 2 sweeps, 60 pairs\n"
    with ScanStore.open("linen.db") as store:
        assert store.units["strain"] == "counts"
        np.testing.assert_allclose(store.load().states[:3, 0], [0, 0.00028, 0.00056], atol=1e-12)


def test_the_folder_of_the_scan_file_is_made(folder, capsys):
    write_csv(folder / "a.csv", [[0.01 * n, 0, 0.0004 * n, 0.02, *range(16)] for n in range(50)])
    assert main(["import", "csv", "a.csv", "--scene", "scene.yaml", "-o", "scans/new/a.db"]) == 0
    assert (folder / "scans/new/a.db").exists()
    assert main(["import", "csv", "a.csv", "--scene", "scene.yaml", "-o", "a.csv/b.db"]) == 2
    assert "a.csv/b.db: expected a folder that can be written" in capsys.readouterr().err


def test_a_bag_becomes_a_scan_file(folder, capsys):
    write_bag(folder / "bag", slide(0, 1000), "sqlite3")
    assert main(["import", "bag", "bag", "bag", "--scene", "scene.yaml", "-o", "scan.db"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "scan.db: 2 sweeps, 394 pairs",
        "  left out 6 of 400 samples without a palm pose near enough in time",
    ]


def test_sweeps_of_a_bag_can_be_found_in_the_motion(folder):
    write_bag(folder / "bag", slide(0, 1000))
    arguments = "bag --scene scene.yaml --detect-sweeps one_way -o scan.db"
    assert main(["import", "bag", *arguments.split()]) == 0
    with ScanStore.open("scan.db") as store:
        assert 150 < store.pairs < 190


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("csv none.csv --scene scene.yaml -o a.db", "none.csv: expected a CSV file"),
        ("csv none.csv --scene none.yaml -o a.db", "none.yaml: expected a scene file"),
        ("csv a.csv --scene scene.yaml --columns none.yaml -o a.db", "none.yaml: expected a column naming"),
        ("csv a.csv --scene scene.yaml --speed 0.1 -o a.db", "expected AXIS=M_PER_S, the scene has 2 axes"),
        ("csv a.csv --scene scene.yaml --speed x=fast -o a.db", "expected a finite number of m/s"),
        ("csv a.csv --scene scene.yaml --speed z=0.1 -o a.db", "speed of axis 'z': expected one of x, y"),
        ("bag none --scene scene.yaml -o a.db", "none: expected a bag, found none"),
        ("bag . --scene scene.yaml -o a.db", "expected a bag (*.mcap, *.db3, or a directory of them)"),
        ("bag b --scene scene.yaml --material-pose 0 0 0 0 0 nan -o a.db", "material_pose: expected x, y"),
    ],
)
def test_what_cannot_be_imported_is_refused_in_one_line(folder, capsys, arguments, message):
    assert main(["import", *arguments.split()]) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith("error: ")
    assert message in printed.err
    assert printed.err.count("\n") == 1
    assert not (folder / "a.db").exists()
