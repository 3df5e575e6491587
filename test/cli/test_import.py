"""The command `import`."""

import csv

import numpy as np
import pytest
from support.bags import SCENE, slide, write_bag
from support.notes import counts

from tactile_localizer.cli import main
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scene_file import load_scene, save_scene
from tactile_localizer.scene import Axis, Phalanx, Scene

HEADER = ["stamp_s", "sweep", "x", "y", *(f"{p}_{g}" for p in ("index", "middle") for g in range(1, 9))]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_scene(SCENE, tmp_path / "scene.yaml")
    return tmp_path


def write_csv(path, rows, names=HEADER):
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([names, *rows])


def test_a_csv_with_standard_columns_is_imported(folder, capsys):
    rng = np.random.default_rng(0)
    rows = [[0.01 * n, n // 50, 0.0004 * n, 0.02, *rng.normal(size=16)] for n in range(200)]
    rows[7][5] = "broken"
    write_csv(folder / "train.csv", rows)
    assert main(["import", "csv", "train.csv", "--scene", "scene.yaml", "-o", "bump_scan"]) == 0
    output = capsys.readouterr().out.splitlines()
    assert output[0] == "bump_scan: 3 sweeps, 125 pairs"
    assert counts(output) == [(1, 200), (74, 199)]
    assert "line 9: 0.07, 0, " in output[1]
    store = ScanFolder("bump_scan")
    assert [sweep.number for sweep in store.sweeps()] == [0, 1, 2]
    assert store.scene == SCENE
    (entry,) = store.history()
    assert (entry["what"], entry["files"]) == ("import csv", ["train.csv"])


def test_a_recording_given_twice_is_refused_and_a_rounded_copy_reported(folder, capsys):
    rng = np.random.default_rng(0)
    rows = [
        [0.01 * n, n // 50, 0.0004 * n % 0.02, 0.02 + 0.001 * (n // 50), *rng.normal(size=16)]
        for n in range(200)
    ]
    write_csv(folder / "a.csv", rows)
    write_csv(folder / "b.csv", [[*row[:2], *(round(value, 6) for value in row[2:])] for row in rows])
    assert main(["import", "csv", "a.csv", "a.csv", "--scene", "scene.yaml", "-o", "a_scan"]) == 2
    assert (
        "a.csv, a.csv: expected every sweep once, found sweep 4 equal to sweep 0" in capsys.readouterr().err
    )
    assert main(["import", "csv", "a.csv", "b.csv", "--scene", "scene.yaml", "-o", "a_scan"]) == 0
    copies = "sweeps that seem to be copies: 0 and 4, 1 and 5, 2 and 6, 3 and 7; the noise"
    assert copies in capsys.readouterr().out


def test_shipped_scenes_and_namings_are_found_by_name(folder, capsys):
    columns = ["timestamp", "proximity1", *(f"channel{n}" for n in range(1, 17))]
    for repeat in (0, 1):
        with (folder / f"{repeat}.csv").open("w") as file:
            file.write(", ".join(columns) + "\n")
            for row in range(30):
                file.write(
                    ",".join(map(str, [443069 + 28 * row, 7, *range(row + repeat, row + repeat + 16)])) + "\n"
                )
    arguments = (
        "0.csv 1.csv --scene linen.yaml --columns fabric_slide.yaml --column x=timestamp*1e-5 -o linen_scan"
    )
    assert main(["import", "csv", *arguments.split()]) == 0
    assert "2 sweeps, 60 pairs" in capsys.readouterr().out
    store = ScanFolder("linen_scan")
    assert store.sweeps()[0].strain_unit == "counts"
    np.testing.assert_allclose(store.load().states[:3, 0], [0, 0.00028, 0.00056], atol=1e-12)
    assert store.history()[0]["columns"]["strain_unit"] == "counts"


def test_the_folder_of_the_scan_file_is_created(folder, capsys):
    write_csv(folder / "a.csv", [[0.01 * n, 0, 0.0004 * n, 0.02, *range(16)] for n in range(50)])
    assert main(["import", "csv", "a.csv", "--scene", "scene.yaml", "-o", "scans/new/a_scan"]) == 0
    assert (folder / "scans/new/a_scan").exists()
    assert main(["import", "csv", "a.csv", "--scene", "scene.yaml", "-o", "a.csv/b_scan"]) == 2
    assert "a.csv/b_scan: expected a writable folder" in capsys.readouterr().err


def test_a_bag_is_imported(folder, capsys):
    write_bag(folder / "bag", slide(0, 1000), "sqlite3")
    assert main(["import", "bag", "bag", "--scene", "scene.yaml", "-o", "bump_scan"]) == 0
    output = capsys.readouterr().out.splitlines()
    assert output[0] == "bump_scan: 1 sweeps, 197 pairs"
    assert counts(output) == [(3, 200)]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("csv none.csv --scene scene.yaml -o a_scan", "none.csv: expected a CSV file"),
        ("csv none.csv --scene none.yaml -o a_scan", "none.yaml: expected a scene file"),
        ("csv a.csv --scene scene.yaml --columns none.yaml -o a_scan", "none.yaml: expected a column naming"),
        (f"csv a.csv --scene {'x' * 300} -o a_scan", "could not read it: File name too long"),
        ("csv a.csv --scene ~nobody7/a.yaml -o a_scan", "~nobody7/a.yaml: expected a scene file"),
        (
            "bag bag --scene scene.yaml --pose-topic /strain -o a_scan",
            "topics: expected different ones, got /strain, /strain",
        ),
        (
            "bag bag --scene scene.yaml --status-topic strain -o a_scan",
            "topics: expected different ones, got /strain, /palm_pose",
        ),
        ("bag none --scene scene.yaml -o a_scan", "none: expected a bag (*.mcap, *.db3"),
        ("bag . --scene scene.yaml -o a_scan", "expected a bag (*.mcap, *.db3, or a directory of them)"),
        ("bag b --scene scene.yaml --material-pose 0 0 0 0 0 nan -o a_scan", "material_pose: expected x, y"),
    ],
)
def test_unusable_files_are_refused_in_one_line(folder, capsys, arguments, message):
    write_bag(folder / "bag", slide(0, 100))
    assert main(["import", *arguments.split()]) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith("error: ")
    assert message in printed.err
    assert printed.err.count("\n") == 1
    assert not (folder / "a_scan").exists()


LINE = Scene("line", (Axis("x", -0.001, 0.06),), (Phalanx("index", (0.0,)),))


def import_table(folder, names, rows, scene=LINE, *more):
    """Import a table; returns the exit status."""
    save_scene(scene, folder / "line.yaml")
    write_csv(folder / "own.csv", rows, names)
    return main(["import", "csv", "own.csv", "--scene", "line.yaml", "-o", "own_scan", *more])


def slid(n=100, channels=8, time=1.0, place=1.0):
    """Rows of a slide over 50 mm in 5 s: time, position, channels."""
    rng = np.random.default_rng(0)
    return [[time * 0.05 * k, place * 0.0005 * k, *rng.normal(size=channels)] for k in range(n)]


NAMED = ["--column", "stamp_s=time", "--column", "finger=taxel1..19"]


def touch_and_poses(folder, place=1.0):
    """Strain of 19 channels at 20 Hz, and poses at 30 Hz with stamps of their own."""
    rows = [[row[0], *row[2:]] for row in slid(channels=19)]
    write_csv(folder / "touch.csv", rows, ["time", *(f"taxel{n}" for n in range(1, 20))])
    poses = [[1e3 * k / 30, place * 0.01 * k / 30] for k in range(150)]
    write_csv(folder / "poses.csv", poses, ["t_ms", "px"])
    named = "--column pose_stamp_s=t_ms*0.001 --column x=px"
    return ["touch.csv", "--poses", "poses.csv", *NAMED, *named.split()]


def test_a_scene_is_proposed_written_and_used(folder, capsys):
    arguments = touch_and_poses(folder)
    assert main(["import", "csv", *arguments, "-o", "own_scan"]) == 0
    printed = capsys.readouterr().out
    for line in (
        "own_scan.scene.yaml: a proposed scene",
        "phalanx finger: 19 channels, taxel1 to taxel19",
        "bounds of x: 0.0 to 49.5 mm (recorded), and 5 mm on each side",
        "motion_std: 0.003",
        "own_scan: 1 sweeps, 100 pairs",
    ):
        assert line in printed
    scene = load_scene("own_scan.scene.yaml")
    assert (scene.layout.counts, scene.axes[0].lower, scene.axes[0].upper) == ((19,), -0.005, 0.0545)
    assert main(["import", "csv", *arguments, "-o", "own_scan"]) == 2
    assert "own_scan.scene.yaml: expected no file; pass it by --scene" in capsys.readouterr().err
    assert main(["import", "csv", *arguments, "--scene", "own_scan.scene.yaml", "-o", "again_scan"]) == 0


def test_a_proposal_has_every_axis_and_the_name_of_its_folder_may_be_long(folder, capsys):
    names = ["time", "x", "y", "yaw", *(f"finger_{n}" for n in range(1, 4))]
    write_csv(folder / "touch.csv", [[0.01 * n, 0.001 * n, 0.0, 0.1, *range(3)] for n in range(60)], names)
    arguments = ["import", "csv", "touch.csv", "--column", "stamp_s=time", "-o"]
    assert main([*arguments, "own_scan"]) == 0
    assert load_scene("own_scan.scene.yaml").axis_names == ("x", "y", "yaw")
    capsys.readouterr()
    assert main([*arguments, "x" * 300]) == 2
    assert "could not write the scene, File name too long" in capsys.readouterr().err


def test_a_proposal_in_millimetres_is_noticed(folder, capsys):
    main(["import", "csv", *touch_and_poses(folder, 1e3), "-o", "own_scan"])
    assert "(positions in mm? --column x=NAME*0.001)" in capsys.readouterr().out


def test_missing_columns_print_a_naming_to_fill_in(folder, capsys):
    touch_and_poses(folder)
    assert main(["import", "csv", "touch.csv", "--scene", "scene.yaml", "-o", "own_scan"]) == 2
    printed = capsys.readouterr()
    assert printed.out.splitlines()[0].startswith("# columns found: time, taxel1, taxel2, ")
    quantities = ["stamp_s", "pose_stamp_s", "x", "y", "index", "middle"]
    assert [line.split(":")[0] for line in printed.out.splitlines()[1:]] == quantities
    assert "pass it by --columns FILE" in printed.err
    assert not (folder / "own_scan").exists()


STANDARD = ["stamp_s", "x", *(f"index_{n}" for n in range(1, 9))]


def test_an_import_that_loses_most_rows_fails(folder, capsys):
    rows = slid(100, 8, place=1e3)
    assert import_table(folder, STANDARD, rows) == 2
    error = capsys.readouterr().err
    assert "x is 0 to 49.5, bounds -0.001 to 0.06" in error
    assert error.count("\n") == 1
    assert not (folder / "own_scan").exists()
    assert import_table(folder, STANDARD, rows, LINE, "--force") == 0


def test_bounds_in_millimetres_are_reported(folder, capsys):
    wide = Scene("line", (Axis("x", -3.0, 63.0),), LINE.phalanges)
    assert import_table(folder, STANDARD, slid(), wide) == 0
    assert (
        "coverage: only 0% of the scene's bounds lie near a pair (bounds in mm?)" in capsys.readouterr().out
    )
    sheet = Scene("sheet", (Axis("x", -3.0, 63.0), Axis("y", -3.0, 63.0)), SCENE.phalanges)
    save_scene(sheet, folder / "sheet.yaml")
    arguments = "own.csv --column y=x --column middle=index_1..8 --scene sheet.yaml -o two_scan"
    assert main(["import", "csv", *arguments.split()]) == 2
    assert "cells, got 1,089,000,000 for the bounds" in capsys.readouterr().err


def test_a_single_line_is_not_taken_for_millimetres(folder, capsys):
    names = ["stamp_s", "x", "y", *STANDARD[2:], *(f"middle_{n}" for n in range(1, 9))]
    rows = [[time, x, 0.02, *strain, *strain] for time, x, *strain in slid()]
    assert import_table(folder, names, rows, SCENE) == 0
    printed = capsys.readouterr().out
    assert "only one sweep" in printed
    assert "mm?" not in printed


def test_a_negative_gap_is_refused(folder, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["import", "csv", "a.csv", "-o", "a_scan", "--max-gap", "-1"])
    assert "argument --max-gap: seconds: expected at least 0, got -1.0" in capsys.readouterr().err


def test_control_characters_of_a_file_are_escaped(folder, capsys):
    rows = slid()
    rows[3][2] = "\x1b[31m"
    assert import_table(folder, STANDARD, rows) == 0
    assert main(["import", "csv", "own.csv", "--column", "x=\x1b[31m", "-o", "b_scan"]) == 2
    save_scene(LINE, folder / "line.yaml")
    write_csv(folder / "c.csv", slid(), ["\x1b[31m", *STANDARD[1:]])
    assert main(["import", "csv", "c.csv", "--scene", "line.yaml", "-o", "b_scan"]) == 2
    printed = capsys.readouterr()
    assert "\x1b" not in printed.out + printed.err
    assert printed.out.count(r"\x1b[31m") == 3
