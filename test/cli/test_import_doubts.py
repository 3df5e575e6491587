"""What is doubtful of a recording is said by the command that imports or replays it."""

import re
from dataclasses import replace

import numpy as np
import pytest
from support.bags import SCENE, slide, write_bag
from support.imports import HEADER, STANDARD, late_strokes, sheet_rows, slid, touch_and_poses, write_csv

from tactile_localizer.cli import main
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scene_file import save_scene
from tactile_localizer.scene import Axis


@pytest.mark.parametrize(
    ("change", "hint"),
    [
        (lambda n, row: [10.0 * n, *row[1:]], "(another unit? --column stamp_s=stamp_s*0.001 for ms"),
        (lambda n, row: [*row[:2], 1e3 * row[2], *row[3:]], "(in mm? --column x=x*0.001)"),
    ],
    ids=["ms", "mm"],
)
def test_a_wrong_unit_is_said_last(folder, run, change, hint):
    rows = [change(n, row) for n, row in enumerate(sheet_rows())]
    rows[7][5] = "broken"
    write_csv(folder / "train.csv", rows)
    save_scene(replace(SCENE, axes=(Axis("x", 0.0, 30.0), Axis("y", 0.0, 0.1))), folder / "large.yaml")
    *_, last = run("csv train.csv --scene large.yaml -o a_scan")[1].splitlines()
    assert hint in last


def test_positions_in_millimetres_are_named_by_their_file_and_column(folder, run, capsys):
    late_strokes(folder / "train.csv", 0)
    run("csv train.csv --scene line.yaml -o a_scan")
    rows = [row.split(",") for row in (folder / "train.csv").read_text().splitlines()]
    write_csv(folder / "strain.csv", [[row[0], *row[3:]] for row in rows[1:]], [rows[0][0], *rows[0][3:]])
    poses = [[row[0], 1e3 * float(row[2])] for row in rows[1:]]
    write_csv(folder / "poses.csv", poses, ["stamp_s", "tcp_mm"])
    reading = "strain.csv --poses poses.csv --column x=tcp_mm"
    hint = "poses.csv: x spans 40 m, the scene 0.061 m (in mm? --column x=tcp_mm*0.001)"
    status, _, refusal = run(f"csv {reading} --scene line.yaml -o b_scan")
    assert status == 2
    assert f"strain.csv: {hint}; skipped 19" in refusal
    main(["replay", *reading.split(), "--scan", "a_scan"])
    assert f"note: {hint}" in capsys.readouterr().out
    assert "in mm?" not in run(f"csv {reading}*0.001 --scene line.yaml -o c_scan")[1]


def test_poses_that_do_not_fit_are_refused_with_the_remedy(folder, run):
    arguments = touch_and_poses(folder)
    write_csv(folder / "poses.csv", [[1e9 + 200 * k, 0.002 * k] for k in range(26)], ["t_ms", "px"])
    for reason, proposed, remedy in (
        (
            "strain from 0.000 to 4.950 s, poses from 1000000.000 to 1000005.000 s",
            "--column pose_stamp_s=t_ms*0.001-1000000.025 shifts the poses",
            "--column pose_stamp_s=t_ms*0.001-1e6",
        ),
        ("the poses are 0.2 s apart", "--max-gap 0.3", "--max-gap 0.3"),
    ):
        status, _, refusal = run(f"{arguments} -o own_scan")
        assert status == 2
        assert reason in refusal
        assert proposed in refusal
        assert not (folder / "own_scan.scene.yaml").exists(), "nothing that a second try would stumble over"
        arguments += f" {remedy}"
    assert run(f"{arguments} -o own_scan")[0] == 0


def test_strain_that_is_late_in_strokes_there_and_back_is_corrected(folder, run):
    late_strokes(folder / "late.csv", 24)
    arguments = "csv late.csv --scene line.yaml"
    printed = run(f"{arguments} -o a_scan")[1]
    assert re.search(
        r"strain is late against the poses by 0\.24\d s \(.*displaced by 9\.\d mm: corrected \(--delay 0",
        printed,
    )
    assert ScanFolder("a_scan").strain_delay_s == pytest.approx(0.24, abs=0.003)
    assert "is late" not in run(f"{arguments} --delay 0 -o b_scan")[1]
    assert "strain is taken as 0.24 s late (--delay)" in run(f"{arguments} --delay 0.24 -o c_scan")[1]
    last_s = [1e-9 * ScanFolder(f"{name}_scan").recording().sweeps[-1].stamp_ns[-1] for name in "abc"]
    assert np.subtract(last_s[1], last_s) == pytest.approx([0.24, 0.0, 0.24], abs=0.003)
    late_strokes(folder / "on_time.csv", 0)
    assert "late" not in run("csv on_time.csv --scene line.yaml -o d_scan")[1]
    true, scan = (ScanFolder(name).load() for name in ("d_scan", "c_scan"))
    rows = np.abs(true.strain[:, None] - scan.strain[None]).sum(axis=2).argmin(axis=0)
    np.testing.assert_allclose(scan.states, true.states[rows], atol=1e-9)


def test_replay_says_of_strain_what_an_import_says(folder, run, capsys):
    late_strokes(folder / "on_time.csv", 0)
    run("csv on_time.csv --scene line.yaml -o a_scan")
    late_strokes(folder / "late.csv", 24)
    main(["replay", "late.csv", "--scan", "a_scan"])
    delay = r"note: late\.csv: strain is late against the poses by 0\.24.*; --delay 0\.24\d corrects it"
    assert re.search(delay, capsys.readouterr().out)
    rows = [row.split(",") for row in (folder / "on_time.csv").read_text().splitlines()]
    write_csv(folder / "strain.csv", [[row[0], *row[3:]] for row in rows[1:]], [rows[0][0], *rows[0][3:]])
    write_csv(folder / "poses.csv", [[row[0], row[2]] for row in rows[1:1501]], ["stamp_s", "x"])
    main(["replay", "strain.csv", "--poses", "poses.csv", "--scan", "a_scan"])
    assert "note: skipped 500 of 2000 samples without a palm pose" in capsys.readouterr().out


def test_a_replay_of_nothing_usable_is_an_error(folder, run, capsys):
    late_strokes(folder / "train.csv", 0)
    run("csv train.csv --scene line.yaml -o a_scan")
    rows = [row.split(",") for row in (folder / "train.csv").read_text().splitlines()]
    write_csv(folder / "strain.csv", [[row[0], *row[3:]] for row in rows[1:601]], [rows[0][0], *rows[0][3:]])
    poses = [[9e4 + float(row[0]), row[2]] for row in rows[1:]]
    write_csv(folder / "poses.csv", poses, ["stamp_s", "x"])
    assert main(["replay", "strain.csv", "--poses", "poses.csv", "--scan", "a_scan"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "strain.csv: poses.csv: the poses are of another recording? they last 20 s" in printed.err
    assert "skipped 600 of 600 samples without a palm pose close enough in time" in printed.err
    assert "shifts the poses" not in printed.err


def test_a_delay_that_strokes_in_one_direction_hide_is_said(folder, run):
    rows, hidden = sheet_rows(), "a delay of the strain against the poses cannot be seen"
    write_csv(folder / "train.csv", rows)
    write_csv(folder / "poses.csv", [[row[0], *row[2:4]] for row in rows], ["stamp_s", "x", "y"])
    assert hidden not in run("csv train.csv --scene scene.yaml -o a_scan")[1], "rows of one source"
    assert hidden in run("csv train.csv --poses poses.csv --scene scene.yaml -o two_scan")[1]
    late_strokes(folder / "late.csv", 24)
    assert (
        "late against the poses by 0.24"
        in run("csv late.csv --scene line.yaml --detect-sweeps one_way -o b_scan")[1]
    )


def test_one_sweep_is_reported_with_the_ways_to_more(folder, run):
    names = ["stamp_s", "", "stroke", "flag", "gripper", "x", "y_mm", *HEADER[4:]]
    rows = [[n[0], k, n[1], k // 30 % 2, 7, n[2], 20 + n[1], *n[4:]] for k, n in enumerate(sheet_rows())]
    write_csv(folder / "train.csv", rows, names)
    arguments = "csv train.csv --scene scene.yaml --column y=y_mm*0.001"
    printed = run(f"{arguments} -o a_scan")[1]
    ways = (
        "for more sweeps: --column sweep=stroke (whole numbers, constant over stretches), or --detect-sweeps"
    )
    assert f"  {ways} both_ways\n" in printed
    assert "for more sweeps" not in run(f"{arguments} --column sweep=stroke -o b_scan")[1]
    write_bag(folder / "bag", slide(0, 1000), "sqlite3")
    assert "  for more sweeps: --detect-sweeps both_ways\n" in run("bag bag --scene scene.yaml -o c_scan")[1]


def test_an_import_that_loses_most_rows_fails(folder, run):
    write_csv(folder / "own.csv", slid(place=1e3), STANDARD)
    assert "x is 0 to 49.5, bounds -0.001 to 0.06" in run("csv own.csv --scene line.yaml -o own_scan")[2]
    assert not (folder / "own_scan").exists()
    assert run("csv own.csv --scene line.yaml -o own_scan --force")[0] == 0
