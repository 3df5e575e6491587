"""The command `import`."""

import csv
import json
import math
import re
import time
from dataclasses import replace
from pathlib import Path

import can
import numpy as np
import pytest
from support.bags import SCENE, STORE, slide, status, write_bag
from support.learned import unexamined, unlearned
from support.notes import counts

from tactile_localizer.cli import main, progress
from tactile_localizer.io.can.protocol import LoadCellProtocol
from tactile_localizer.io.scans.folder import ScanFolder
from tactile_localizer.io.scene_file import load_scene, save_scene
from tactile_localizer.library import read_recording
from tactile_localizer.resources import resource_path
from tactile_localizer.scene import Axis, Phalanx, Scene

HEADER = ["stamp_s", "sweep", "x", "y", *(f"{p}_{g}" for p in ("index", "middle") for g in range(1, 9))]
STANDARD = ["stamp_s", "x", *(f"index_{n}" for n in range(1, 9))]
LINE = Scene("line", (Axis("x", -0.001, 0.06),), (Phalanx("index", (0.0,)),))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_scene(SCENE, tmp_path / "scene.yaml")
    save_scene(LINE, tmp_path / "line.yaml")
    return tmp_path


@pytest.fixture
def run(folder, capsys, monkeypatch):
    """Function that runs an import; returns its status and what it printed, without progress."""
    monkeypatch.setattr(progress, "LINE_EVERY_S", math.inf)  # on a busy machine there would be lines of it
    monkeypatch.setattr("tactile_localizer.cli.import_.learn_and_keep", unlearned)
    monkeypatch.setattr("tactile_localizer.io.scans.learned.learn_model", unexamined)

    def call(arguments, *more):
        status = main(["import", *arguments.split(), *more])
        printed = capsys.readouterr()
        assert printed.err.count("\n") == (status != 0), "one line"
        return status, printed.out, printed.err

    return call


def write_csv(path, rows, names=HEADER):
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([names, *rows])


def sheet_rows():
    """Four sweeps in 200 rows."""
    noise = np.random.default_rng(0).normal(size=(200, 16))
    return [[0.01 * n, n // 50, 0.0004 * n % 0.02, 0.02 + 0.001 * (n // 50), *noise[n]] for n in range(200)]


def slid(channels=8, place=1.0):
    """Rows of a slide over 50 mm in 5 s: time, position, channels."""
    rng = np.random.default_rng(0)
    return [[0.05 * k, place * 0.0005 * k, *rng.normal(size=channels)] for k in range(100)]


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


def touch_and_poses(folder, place=1.0):
    """Strain of 19 channels at 20 Hz, and poses at 30 Hz with stamps of their own."""
    rows = [[row[0], *row[2:]] for row in slid(channels=19)]
    write_csv(folder / "touch.csv", rows, ["time", *(f"taxel{n}" for n in range(1, 20))])
    poses = [[1e3 * k / 30, place * 0.01 * k / 30] for k in range(150)]
    write_csv(folder / "poses.csv", poses, ["t_ms", "px"])
    strain = "--column stamp_s=time --column finger=taxel1..19"
    return f"csv touch.csv --poses poses.csv {strain} --column pose_stamp_s=t_ms*0.001 --column x=px"


def test_a_scene_is_proposed_written_and_used(folder, run):
    arguments = touch_and_poses(folder)
    status, printed, _ = run(f"{arguments} -o own_scan")
    assert status == 0
    for line in (
        "own_scan.scene.yaml: a proposed scene",
        "phalanx finger: 19 channels, taxel1 to taxel19",
        "bounds of x: 0.0 to 49.5 mm (recorded), and 5 mm on each side",
        "motion_std: 0.003",
        "own_scan: 1 sweep, 100 pairs",
    ):
        assert line in printed
    scene = load_scene("own_scan.scene.yaml")
    assert (scene.layout.counts, scene.axes[0].lower, scene.axes[0].upper) == ((19,), -0.005, 0.0545)
    assert "own_scan.scene.yaml: expected no file; pass it by --scene" in run(f"{arguments} -o own_scan")[2]
    assert run(f"{arguments} --scene own_scan.scene.yaml -o again_scan")[0] == 0


def test_a_proposal_has_every_axis(folder, run):
    names = ["time", "palm_1", "y", "yaw", *(f"finger_{n}" for n in range(1, 4))]
    write_csv(folder / "touch.csv", [[0.01 * n, 0.001 * n, 0.0, 0.1, *range(3)] for n in range(60)], names)
    assert run("csv touch.csv --column stamp_s=time --column x=palm_1 -o own_scan")[0] == 0
    scene = load_scene("own_scan.scene.yaml")
    assert (scene.axis_names, scene.phalanx_names) == (("x", "y", "yaw"), ("finger",))
    assert (scene.axes[2].lower, scene.axes[2].upper) == (0.0, 0.2)
    refusal = run(f"csv touch.csv --column stamp_s=time -o {'x' * 300}")[2]
    assert "expected a writable folder, File name too long" in refusal


def test_a_proposal_in_millimetres_is_noticed(folder, run):
    arguments = touch_and_poses(folder, 1e3)
    hint = "poses.csv: x spans 49.67 m (in mm? --column x=px*0.001)"
    assert hint in run(f"{arguments} -o own_scan")[1]
    status, _, refusal = run(f"{arguments} --column y=px -o sheet_scan")
    assert status == 2
    assert refusal.index(hint) < refusal.index("expected at most 1,000,000 cells")


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


def late_strokes(path, late_rows):
    """Strokes of 40 mm there and back at 20 mm/s, a sample each 10 ms, of smooth strain that is late."""
    rng = np.random.default_rng(2)
    places, weights = rng.uniform(0.0, 40.0, 30), rng.normal(size=(30, 8))
    x = np.abs((np.arange(2000) * 0.2 + 40) % 80 - 40)
    strain = np.exp(-0.5 * ((np.roll(x, late_rows)[:, None] - places) / 2) ** 2) @ weights
    rows = np.column_stack([0.01 * np.arange(2000), np.arange(2000) // 200, 1e-3 * x, strain])[late_rows:]
    write_csv(path, rows, ["stamp_s", "sweep", "x", *(f"index_{n}" for n in range(1, 9))])


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


@pytest.mark.parametrize(
    "columns",
    [
        ["L1", "L2", "L3", "R1", "R2", "R3"],
        ["left_fx", "left_fy", "left_fz", "right_fx", "right_fy", "right_fz"],
        ["Left 1, N", "Left 2, N", "Left 3, N", "Right 1, N", "Right 2, N", "Right 3, N"],
        ["/left/strain[0]", "/left/strain[1]", "/left/strain[2]", "/r[0]", "/r[1]", "/r[2]"],
    ],
)
def test_the_phalanges_of_own_column_names_are_proposed(folder, run, columns):
    write_csv(folder / "own.csv", slid(channels=6), ["stamp_s", "x", *columns])
    status, printed, _ = run("csv own.csv -o own_scan")
    assert status == 2
    (folder / "naming.yaml").write_text(printed)
    status, printed, _ = run("csv own.csv --columns naming.yaml -o own_scan")
    assert status == 0
    assert load_scene("own_scan.scene.yaml").layout.counts == (3, 3)


def test_missing_columns_print_a_naming_to_fill_in(folder, run):
    touch_and_poses(folder)
    status, printed, refusal = run("csv touch.csv --scene scene.yaml -o own_scan")
    first, *lines = printed.splitlines()
    assert status == 2
    assert first.startswith("# columns found: time, taxel1, taxel2, ")
    quantities = ["stamp_s", "pose_stamp_s", "x", "y", "index", "middle"]
    assert [line.split(":")[0] for line in lines] == [
        *quantities[:2],
        "sweep",
        *quantities[2:],
        "strain_unit",
    ]
    assert "pass it by --columns FILE" in refusal
    columns = ("time", "t_ms*0.001", "px", "px", "taxel1..8", "taxel9..16")
    for quantity, column in zip(quantities, columns, strict=True):
        printed = re.sub(f"^{quantity}: ", f"{quantity}: {column} ", printed, flags=re.MULTILINE)
    (folder / "filled.yaml").write_text(printed)
    assert run("csv touch.csv --poses poses.csv --columns filled.yaml --scene scene.yaml -o own_scan")[0] == 0


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


@pytest.mark.parametrize("scene", ["", "--scene two.yaml"])
def test_one_naming_has_the_columns_of_strain_and_poses(folder, run, scene):
    touch_and_poses(folder)
    save_scene(replace(LINE, phalanges=(Phalanx("taxel", (0.0,), 19),)), folder / "two.yaml")
    status, printed, refusal = run(f"csv touch.csv --poses poses.csv {scene} -o own_scan")
    assert status == 2
    assert "# columns found in touch.csv: time, taxel1" in printed
    assert "# columns found in poses.csv: t_ms, px" in printed
    assert refusal.endswith("; or fill in the naming above and pass it by --columns FILE\n")
    filled = {"stamp_s": "time", "pose_stamp_s": "t_ms * 0.001", "x": "px"}
    for quantity, column in (filled | {"taxel": "taxel1..19"} if scene else filled).items():
        printed = re.sub(f"^{quantity}: ", f"{quantity}: {column} ", printed, flags=re.MULTILINE)
    (folder / "filled.yaml").write_text(printed)
    arguments = f"csv touch.csv --poses poses.csv --columns filled.yaml {scene} -o own_scan"
    assert "phalanx taxel: 19 channels" in run(arguments)[1] or scene
    assert ScanFolder("own_scan").recording().sweeps[0].strain_unit == "V"


def test_a_replay_without_the_poses_of_the_import_asks_for_them(folder, run, capsys):
    assert run(f"{touch_and_poses(folder)} -o own_scan")[0] == 0
    assert main(["replay", "touch.csv", "--scan", "own_scan"]) == 2
    printed = capsys.readouterr()
    assert printed.err == (
        "error: touch.csv: expected --poses FILE beside it, as own_scan was imported with poses.csv; "
        "found no column for x\n"
    )
    assert main(["replay", "poses.csv", "--poses", "poses.csv", "--scan", "own_scan"]) == 2
    assert "naming above" not in capsys.readouterr().err


def test_an_import_that_loses_most_rows_fails(folder, run):
    write_csv(folder / "own.csv", slid(place=1e3), STANDARD)
    assert "x is 0 to 49.5, bounds -0.001 to 0.06" in run("csv own.csv --scene line.yaml -o own_scan")[2]
    assert not (folder / "own_scan").exists()
    assert run("csv own.csv --scene line.yaml -o own_scan --force")[0] == 0


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
