"""The command `import`."""

import json
import time
from dataclasses import replace
from pathlib import Path

import can
import numpy as np
import pytest
from support.bags import SCENE, STORE, slide, status, write_bag
from support.imports import LINE, STANDARD, sheet_rows, slid, write_csv
from support.notes import counts

from tactile_localizer.cli import main
from tactile_localizer.io.can.protocol import LoadCellProtocol
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scene_file import save_scene
from tactile_localizer.library import read_recording
from tactile_localizer.resources import resource_path


def test_a_csv_with_standard_columns_is_imported(folder, run):
    rows = sheet_rows()
    rows[7][5], rows[8][2], rows[9][2] = "broken", 1.0, -1.0
    write_csv(folder / "train.csv", rows)
    status, printed, _ = run("csv train.csv --scene scene.yaml -o scans/new/bump_scan")
    output = printed.splitlines()
    assert (status, output[0]) == (0, "scans/new/bump_scan: 4 sweeps, 197 pairs")
    assert counts(output) == [(1, 200), (2, 199)]
    assert "line 9, column index_2: expected a number, found 'broken'" in output[1]
    store = ScanFolder("scans/new/bump_scan")
    assert [sweep.number for sweep in store.recording().sweeps] == [0, 1, 2, 3]
    assert store.scene == SCENE
    (entry,) = store.history()
    assert (entry["what"], entry["files"]) == ("import csv", ["train.csv"])


def write_can_log(path, dbc, messages=None):
    """A log of a finger that slides over 50 mm in 5 s at 100 Hz, beside other frames, and its poses."""
    hand = LoadCellProtocol(resource_path(f"config/{dbc}"), ["index"], messages)
    noise = np.random.default_rng(0).uniform(-1, 1, (500, 8))
    with can.Logger(path) as log:
        for number in range(500):
            for frame in hand.encode(0, noise[number], number, stamp_s=1_764_000_000 + 0.01 * number):
                log.on_message_received(frame)
            log.on_message_received(can.Message(timestamp=frame.timestamp, arbitration_id=0x700))
    write_csv(
        Path("poses.csv"), [[1_764_000_000 + 0.02 * n, 0.0002 * n] for n in range(251)], ["stamp_s", "x"]
    )
    return noise


def test_a_can_log_is_imported_with_poses_of_a_file(folder, run):
    noise = write_can_log(folder / "sweep.asc", "loadcells.dbc")
    options = "--dbc loadcells.dbc --poses poses.csv --scene line.yaml"
    status, printed, _ = run(f"can sweep.asc {options} -o a_scan")
    assert status == 0, printed
    (sweep,) = ScanFolder("a_scan").recording().sweeps
    assert len(sweep) >= 498
    np.testing.assert_allclose(sweep.strain, noise[-len(sweep) :], atol=0.0002)
    np.testing.assert_allclose(sweep.position[:, 0], 1e-4 * np.arange(500)[-len(sweep) :], atol=1e-6)
    assert ScanFolder("a_scan").history()[0]["what"] == "import can"


def test_a_can_log_is_replayed_on_the_scan_of_one(folder, run, capsys):
    noise = write_can_log(folder / "sweep.log", "loadcells.dbc")
    assert run("can sweep.log --dbc loadcells.dbc --poses poses.csv --scene line.yaml -o a_scan")[0] == 0
    replay = ["replay", "sweep.log", "--scan", "a_scan", "--config", "fast", "--json", "out.json"]
    assert main([*replay, "--dbc", "loadcells.dbc", "--poses", "poses.csv"]) < 2
    assert len(json.loads(Path("out.json").read_text())["updates"]) >= 498
    (sweep,) = read_recording("sweep.log", LINE, dbc="loadcells.dbc", poses=["poses.csv"]).sweeps
    np.testing.assert_allclose(sweep.strain, noise[-len(sweep) :], atol=0.0002)
    capsys.readouterr()
    assert main(replay) == 2
    assert capsys.readouterr().err.startswith("error: CAN log: expected --dbc FILE with the layout")


@pytest.mark.parametrize(
    ("zone", "hint", "shift"), [("CET-1", "TZ=UTC-1", 3600), ("UTC+3:30", "TZ=UTC+3:30", -12600)]
)
def test_a_log_of_another_time_zone_is_named_with_the_remedy(folder, run, monkeypatch, zone, hint, shift):
    for number in range(2):
        monkeypatch.setenv("TZ", (zone, "UTC")[number])
        time.tzset()
        if not number:
            write_can_log(folder / "sweep.asc", "loadcells.dbc")
    arguments = "can sweep.asc --dbc loadcells.dbc --poses poses.csv --scene line.yaml -o a_scan"
    status, _, refusal = run(arguments)
    assert status == 2
    way = "behind" if shift > 0 else "ahead of"
    assert (
        f"error: sweep.asc: poses.csv: the poses are {abs(shift)} s {way} the strain, another tim" in refusal
    )
    assert f"{hint} reads it as such; --column pose_stamp_s=stamp_s{shift:+} shifts the poses" in refusal
    status, printed, _ = run(f"{arguments} --column pose_stamp_s=stamp_s{shift:+}")
    assert status == 0, printed
    assert ScanFolder("a_scan").recording().sweeps[0].position[-1, 0] == pytest.approx(0.0499)
    monkeypatch.undo()
    time.tzset()


def test_a_log_that_is_mostly_unreadable_is_imported_by_force_only(folder, run):
    write_can_log(folder / "sweep.log", "loadcells.dbc")
    foreign = "(1764000000.000000) can0 00000123#80:00:00000000#11\n"
    whole = (folder / "sweep.log").read_text()
    (folder / "sweep.log").write_text(whole + foreign * (whole.count("\n") + 10))
    arguments = "can sweep.log --dbc loadcells.dbc --poses poses.csv --scene line.yaml -o a_scan"
    status, _, refusal = run(arguments)
    assert status == 2
    assert "expected at least half of" in refusal
    assert "left out" in refusal
    assert run(f"{arguments} --force")[0] == 0


def test_a_can_log_is_read_with_the_parameters_of_the_driver(folder, run):
    noise = write_can_log(folder / "sweep.log", "loadcells_fd.dbc", {"index": ["middle"]})
    parameters = (
        "/**:\n  ros__parameters:\n    messages: {index: [middle]}\n    gauge_signals: [gauge_2, gauge_1]\n"
    )
    (folder / "driver.yaml").write_text(parameters)
    save_scene(replace(LINE, phalanges=(replace(LINE.phalanges[0], channels=2),)), folder / "line.yaml")
    options = "--params-file driver.yaml --dbc loadcells_fd.dbc --poses poses.csv --scene line.yaml"
    assert run(f"can sweep.log {options} -o a_scan")[0] == 0
    strain = ScanFolder("a_scan").recording().sweeps[0].strain
    np.testing.assert_allclose(strain, noise[-len(strain) :, [1, 0]], atol=0.0001)


def test_a_recording_given_twice_is_refused(folder, run):
    write_csv(folder / "a.csv", sheet_rows())
    refusal = run("csv a.csv a.csv --scene scene.yaml -o a_scan")[2]
    assert "a.csv, a.csv: expected every sweep once, found sweep 4 equal to sweep 0" in refusal


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_shipped_scenes_and_namings_are_found_by_name(folder, run):
    columns = ["timestamp", " proximity1", *(f" channel{n}" for n in range(1, 17))]
    for repeat in (0, 1):
        rows = [[443069 + 28 * row, 7, *range(row + repeat, row + repeat + 16)] for row in range(30)]
        write_csv(folder / f"{repeat}.csv", rows, columns)
    naming = "--columns fabric_slide.yaml --column x=timestamp*1e-5"
    assert "2 sweeps, 60 pairs" in run(f"csv 0.csv 1.csv --scene linen.yaml {naming} -o linen_scan")[1]
    store = ScanFolder("linen_scan")
    assert store.recording().sweeps[0].strain_unit == "counts"
    np.testing.assert_allclose(store.load().states[:3, 0], [0, 0.00028, 0.00056], atol=1e-12)
    assert store.history()[0]["columns"]["strain_unit"] == "counts"


def test_a_bag_is_imported(folder, run):
    write_bag(folder / "bag", slide(0, 1000), "sqlite3")
    output = run("bag bag --scene scene.yaml -o bump_scan")[1].splitlines()
    assert output[0] == "bump_scan: 1 sweep, 197 pairs"
    assert counts(output) == [(3, 200)]


def test_an_imported_bag_has_the_sweeps_of_the_mapping_status(folder, run):
    marked = [(100, True, 1), (500, False, 1), (600, True, 2), (900, False, 2)]
    happened = [
        ("tactile_mapping/status", ms + 5, status(ms, active, number)) for ms, active, number in marked
    ]
    write_bag(folder / "bag", slide(0, 1000) + happened)
    assert run("bag bag --scene scene.yaml -o bump_scan")[1].startswith("bump_scan: 2 sweeps, ")


def test_messages_of_all_bags_of_an_import_name_their_values_alike(folder, run):
    names, joints = [f"joint_{n}" for n in range(8)], STORE.types["sensor_msgs/msg/JointState"]
    for bag, named in (("a", names), ("b", names[::-1])):
        poses = [each for each in slide(0, 1000) if each[0] == "palm_pose"]
        efforts = [
            ("joints", ms, joints(each.header, named, np.empty(0), np.empty(0), np.arange(8.0)))
            for _, ms, each in poses
        ]
        write_bag(folder / bag, poses + efforts)
    entry = "{topic: /joints, type: sensor_msgs/msg/JointState, field: effort}"
    (folder / "adapter.yaml").write_text(f"phalanges: {{index: {entry}}}\n")
    options = "--adapter adapter.yaml --scene line.yaml"
    assert run(f"bag a {options} -o a_scan")[0] == 0
    refusal = run(f"bag a b {options} -o both_scan")[2]
    assert "expected names joint_0, joint_1" in refusal


def test_each_file_of_an_import_has_its_own_poses(folder, run):
    for name, place in (("a", 1.0), ("b", 0.5)):
        write_csv(
            folder / f"{name}.csv", [[row[0], *row[2:]] for row in slid()], [STANDARD[0], *STANDARD[2:]]
        )
        poses = [[0.04 * k, place * 0.0004 * k] for k in range(125)]
        write_csv(folder / f"{name}_poses.csv", poses, ["stamp_s", "x"])
    assert (
        run("csv a.csv b.csv --poses a_poses.csv --poses b_poses.csv --scene line.yaml -o both_scan")[0] == 0
    )
    first, second = ScanFolder("both_scan").recording().sweeps
    np.testing.assert_allclose(second.position, 0.5 * first.position, atol=1e-9)


CAN = "can sweep.log --dbc loadcells.dbc"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("csv a.csv --scene scene.yaml --columns none.yaml", "none.yaml: expected a column naming"),
        (f"csv a.csv --scene {'x' * 300}", "could not read it: File name too long"),
        ("csv a.csv --scene ~nobody7/a.yaml", "~nobody7/a.yaml: expected a scene file"),
        (
            "bag bag --scene scene.yaml --status-topic strain",
            "expected different ones, got /strain, /pa",
        ),
        ("bag b --scene scene.yaml --material-pose 0 0 0 0 0 nan", "material_pose: expected x, y"),
        (f"{CAN} --scene line.yaml", "expected --poses FILE with the palm positions"),
        (f"{CAN} --scene scene.yaml --poses poses.csv", "poses.csv: expected"),
        (
            f"{CAN} --scene line.yaml --poses poses.csv --params-file poses.csv",
            "poses.csv: parameters: expected a mapping",
        ),
    ],
)
def test_unusable_files_are_refused_in_one_line(folder, run, arguments, message):
    write_bag(folder / "bag", slide(0, 100))
    write_can_log(folder / "sweep.log", "loadcells.dbc")
    status, _, refusal = run(f"{arguments} -o a_scan")
    assert status == 2
    assert refusal.startswith("error: ")
    assert message in refusal
    assert not (folder / "a_scan").exists()


def test_sweeps_of_a_csv_are_detected_in_one_or_both_directions(folder, run):
    rows = [[0.01 * n, abs(0.05 - 0.001 * (n % 100)), *sheet_rows()[n][4:12]] for n in range(200)]
    write_csv(folder / "a.csv", rows, STANDARD)
    for directions, sweeps in (("both_ways", 4), ("one_way", 2)):
        printed = run(f"csv a.csv --scene line.yaml --detect-sweeps {directions} -o {directions}")[1]
        assert f"{directions}: {sweeps} sweeps, " in printed
        assert "samples are in no detected sweep" in printed
    assert ScanFolder("one_way").history()[0]["detect_sweeps"] == "one_way"
    write_csv(folder / "b.csv", [[row[0], 0.02, *row[2:]] for row in rows], STANDARD)
    refusal = run("csv b.csv --scene line.yaml --detect-sweeps one_way -o b_scan")[2]
    assert "200 of 200 samples are in no detected sweep" in refusal


def test_control_characters_of_a_file_are_escaped(folder, run):
    rows = slid()
    rows[3][2] = "\x1b[31m"
    write_csv(folder / "own.csv", rows, STANDARD)
    write_csv(folder / "c.csv", slid(), ["\x1b[31m", *STANDARD[1:]])
    printed = run("csv own.csv --scene line.yaml -o own_scan")[1:]
    printed += (
        run("csv own.csv -o b_scan --column", "x=\x1b[31m")[1:] + run("csv c.csv --scene line.yaml -o b")[1:]
    )
    assert "\x1b" not in "".join(printed)
    assert "".join(printed).count(r"\x1b[31m") == 5
