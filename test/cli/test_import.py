"""The command `import`."""

import csv

import numpy as np
import pytest
from support.bags import SCENE, slide, write_bag
from support.notes import counts

from tactile_localizer.cli import main
from tactile_localizer.io.csv.columns import load_naming
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scene_file import save_scene
from tactile_localizer.scene import Axis, Phalanx, Scene

HEADER = ["stamp_s", "sweep", "x", "y", *(f"{p}_{g}" for p in ("index", "middle") for g in range(1, 9))]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_scene(SCENE, tmp_path / "scene.yaml")
    return tmp_path


def write_csv(path, rows):
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([HEADER, *rows])


def test_a_csv_with_standard_columns_is_imported(folder, capsys):
    rng = np.random.default_rng(0)
    rows = [[0.01 * n, n // 50, 0.0004 * n, 0.02, *rng.normal(size=16)] for n in range(200)]
    rows[7][5] = "broken"
    write_csv(folder / "train.csv", rows)
    assert main(["import", "csv", "train.csv", "--scene", "scene.yaml", "-o", "bump_scan"]) == 0
    output = capsys.readouterr().out.splitlines()
    assert output[0] == "bump_scan: 3 sweeps, 125 pairs"
    assert counts(output) == [(1, 200), (74, 199), (1, 4)]
    assert "line 9, index_2 'broken'" in output[1]
    store = ScanFolder("bump_scan")
    assert [sweep.number for sweep in store.sweeps()] == [0, 1, 2]
    assert store.scene == SCENE
    (entry,) = store.history()
    assert (entry["what"], entry["files"]) == ("import csv", ["train.csv"])


def test_shipped_scenes_and_namings_are_found_by_name(folder, capsys):
    columns = ["timestamp", "proximity1", *(f"channel{n}" for n in range(1, 17))]
    for repeat in (0, 1):
        with (folder / f"{repeat}.csv").open("w") as file:
            file.write(", ".join(columns) + "\n")
            for row in range(30):
                file.write(
                    ",".join(map(str, [443069 + 28 * row, 7, *range(row + repeat, row + repeat + 16)])) + "\n"
                )
    arguments = "0.csv 1.csv --scene linen.yaml --columns fabric_slide.yaml --speed 0.01 -o linen_scan"
    assert main(["import", "csv", *arguments.split()]) == 0
    assert "2 sweeps, 60 pairs" in capsys.readouterr().out
    store = ScanFolder("linen_scan")
    assert store.sweeps()[0].strain_unit == "counts"
    np.testing.assert_allclose(store.load().states[:3, 0], [0, 0.00028, 0.00056], atol=1e-12)


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
    assert main(["import", "bag", "bag", "bag", "--scene", "scene.yaml", "-o", "again_scan"]) == 2
    assert "found sweep 2 equal to sweep 1; is a recording given twice?" in capsys.readouterr().err


def test_sweeps_of_a_bag_are_detected_in_the_motion(folder):
    write_bag(folder / "bag", slide(0, 1000))
    arguments = "bag --scene scene.yaml --detect-sweeps one_way -o bump_scan"
    assert main(["import", "bag", *arguments.split()]) == 0
    store = ScanFolder("bump_scan")
    assert 150 < len(store.load()) < 190


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("csv none.csv --scene scene.yaml -o a_scan", "none.csv: expected a CSV file"),
        ("csv none.csv --scene none.yaml -o a_scan", "none.yaml: expected a scene file"),
        ("csv a.csv --scene scene.yaml --columns none.yaml -o a_scan", "none.yaml: expected a column naming"),
        ("csv a.csv --scene scene.yaml --speed 0.1 -o a_scan", "expected AXIS=M_PER_S, the scene has 2 axes"),
        ("csv a.csv --scene scene.yaml --speed x=fast -o a_scan", "expected a finite number of m/s"),
        ("csv a.csv --scene scene.yaml --speed z=0.1 -o a_scan", "speed of axis 'z': expected one of x, y"),
        ("bag none --scene scene.yaml -o a_scan", "none: expected a bag, found none"),
        ("bag . --scene scene.yaml -o a_scan", "expected a bag (*.mcap, *.db3, or a directory of them)"),
        ("bag b --scene scene.yaml --material-pose 0 0 0 0 0 nan -o a_scan", "material_pose: expected x, y"),
    ],
)
def test_unusable_files_are_refused_in_one_line(folder, capsys, arguments, message):
    assert main(["import", *arguments.split()]) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith("error: ")
    assert message in printed.err
    assert printed.err.count("\n") == 1
    assert not (folder / "a_scan").exists()


LINE = Scene("line", (Axis("x", -0.001, 0.06),), (Phalanx("index", (0.0,)),))


def import_table(folder, names, rows, scene=LINE, *more):
    """Import a table of one's own; returns the exit status."""
    save_scene(scene, folder / "line.yaml")
    with (folder / "own.csv").open("w", newline="") as file:
        csv.writer(file).writerows([names, *rows])
    return main(["import", "csv", "own.csv", "--scene", "line.yaml", "-o", "own_scan", *more])


def slid(n=100, channels=8, time=1.0, place=1.0):
    """Rows of a slide over 50 mm in 5 s: time, position, channels."""
    rng = np.random.default_rng(0)
    return [[time * 0.05 * k, place * 0.0005 * k, *rng.normal(size=channels)] for k in range(n)]


@pytest.mark.parametrize(
    ("names", "factors", "scales"),
    [
        (["time_ms", "pos_x_mm"], (1e3, 1e3), (0.001, 0.001)),
        (["Time (s)", "Position [in]"], (1, 39.37), (1, 0.0254)),
        (["timestamp", "x_position"], (1e9, 1e2), (1e-9, 0.01)),
        (["t", "tcp.x"], (1e3, 1), (0.001, 1)),
    ],
)
def test_guessed_columns_are_printed_and_written(folder, capsys, names, factors, scales):
    names = [*names, *(f"taxel{n}" for n in range(8))]
    assert import_table(folder, names, slid(100, 8, *factors)) == 0
    printed = capsys.readouterr().out
    assert "taxel0 to taxel7 (8)" in printed
    naming = load_naming("own_scan.columns.yaml")
    assert (float(naming.of("stamp_s").scale), float(naming.of("x").scale)) == pytest.approx(scales)
    store = ScanFolder("own_scan")
    recording = store.recording().sweeps[0]
    np.testing.assert_allclose(recording.position[:, 0], 0.0005 * np.arange(100), atol=1e-6)
    np.testing.assert_allclose(np.diff(recording.stamp_ns) * 1e-9, 0.05, atol=1e-6)
    again = ["import", "csv", "own.csv", "--scene", "line.yaml", "--columns", "own_scan.columns.yaml"]
    assert main([*again, "-o", "again_scan"]) == 0
    assert "1 sweeps, 100 pairs" in capsys.readouterr().out


def test_a_wrench_and_a_constant_speed_are_guessed(folder, capsys):
    scene = Scene("line", LINE.axes, (Phalanx("index", (0.0,), 6),))
    names = ["time_s", "speed_mmps", *(f"index.{part}" for part in ("fx", "fy", "fz", "tx", "ty", "tz"))]
    rows = [[row[0], 10.0, *row[2:]] for row in slid(channels=6)]
    assert import_table(folder, names, rows, scene) == 0
    assert "0.01 m/s x time" in capsys.readouterr().out
    store = ScanFolder("own_scan")
    np.testing.assert_allclose(store.load().states[:, 0], 0.0005 * np.arange(100), atol=1e-9)


def test_numbered_columns_are_split_among_phalanges(folder, capsys):
    scene = Scene("line", LINE.axes, (Phalanx("distal", (0.0,), 6), Phalanx("proximal", (0.0,), 4)))
    names = ["time_s", "x", *(f"ch{n}" for n in range(1, 11))]
    assert import_table(folder, names, slid(channels=10), scene) == 0
    assert "ch7 to ch10 (4)" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("names", "channels", "messages"),
    [
        (["time_s"], 8, ["a position on x", "--speed M_PER_S if the hand moved at constant speed"]),
        (["time_s", "x"], 19, ["write channels: 19 below index in the scene"]),
        (["time_s", "x"], 6, ["write channels: 6 below index in the scene"]),
        (["when", "x"], 8, ["time stamps (--column stamp_s=NAME"]),
    ],
)
def test_missing_columns_are_named_with_a_hint(folder, capsys, names, channels, messages):
    rows = [row[: len(names)] + row[2:] for row in slid(channels=channels)]
    assert import_table(folder, [*names, *(f"e{n + 1}" for n in range(channels))], rows) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert all(message in error for message in messages)
    assert not (folder / "own_scan").exists()


STANDARD = ["stamp_s", "x", *(f"index_{n}" for n in range(1, 9))]


@pytest.mark.parametrize(
    ("time", "place", "hint"),
    [
        (1, 1e3, "x seems to be in mm: --column x=x*0.001"),
        (1, 1e2, "x seems to be in cm: --column x=x*0.01"),
        (1, 39.37, "x seems to be in inches: --column x=x*0.0254"),
    ],
)
def test_an_import_that_loses_most_rows_fails_and_guesses_the_unit(folder, capsys, time, place, hint):
    rows = slid(100, 8, time, place)
    assert import_table(folder, STANDARD, rows) == 2
    error = capsys.readouterr().err
    assert hint in error
    assert error.count("\n") == 1
    assert not (folder / "own_scan").exists()
    assert import_table(folder, STANDARD, rows, LINE, "--force") == 0
    assert hint in capsys.readouterr().out


def test_milliseconds_with_a_constant_speed_are_guessed(folder, capsys):
    rows = [[row[0], *row[2:]] for row in slid(time=1e3)]
    names = [STANDARD[0], *STANDARD[2:]]
    assert import_table(folder, names, rows, LINE, "--speed", "0.01") == 2
    assert "stamp_s seems to be in ms: --column stamp_s=stamp_s*0.001" in capsys.readouterr().err


def test_stamps_too_large_for_seconds_are_refused(folder, capsys):
    rows = [[1.7e12 + 50 * k, *row[1:]] for k, row in enumerate(slid())]
    assert import_table(folder, STANDARD, rows) == 2
    assert "too large (in ms? --column stamp_s=NAME*0.001" in capsys.readouterr().err


def test_degrees_are_guessed(folder, capsys):
    turn = Scene("line", (Axis("yaw", -0.3, 0.3),), LINE.phalanges)
    rows = [[row[0], -15 + 0.3 * k, *row[2:]] for k, row in enumerate(slid())]
    assert import_table(folder, ["stamp_s", "yaw", *STANDARD[2:]], rows, turn) == 2
    assert "yaw seems to be in degrees: --column yaw=yaw*0.0174533" in capsys.readouterr().err


@pytest.mark.parametrize("order", ["reversed", "shuffled"])
def test_rows_in_another_order_are_sorted_by_stamp(folder, capsys, order):
    rows = slid()
    rows = rows[::-1] if order == "reversed" else [rows[k] for k in np.random.default_rng(1).permutation(100)]
    assert import_table(folder, STANDARD, rows) == 0
    assert "sorted 1 sweeps with backward stamps" in capsys.readouterr().out
    store = ScanFolder("own_scan")
    np.testing.assert_allclose(store.load().states[:, 0], 0.0005 * np.arange(100), atol=1e-9)


def test_a_negative_speed_reverses_the_sweep(folder):
    rows = [[row[0], *row[2:]] for row in slid()]
    names = [STANDARD[0], *STANDARD[2:]]
    assert import_table(folder, names, rows, LINE, "--speed", "-0.01") == 0
    store = ScanFolder("own_scan")
    np.testing.assert_allclose(store.load().states[:, 0], 0.0495 - 0.0005 * np.arange(100), atol=1e-9)
