"""CSV files are read by the names of their columns; invalid rows are skipped, counted and reported."""

import re
from contextlib import suppress
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.csv_files import GAUGES, HEADER, LINE, line_rows, write_csv

from tactile_localizer.errors import ScanError
from tactile_localizer.io.csv.columns import (
    ColumnNaming,
    naming_from_pairs,
)
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.scene import Axis, Phalanx, Scene
from tactile_localizer.streams.session import Session

SCENE = Scene(
    "bump", (Axis("x", 0, 1), Axis("y", 0, 1)), (Phalanx("index", (0, 0)), Phalanx("middle", (0, 0)))
)
SCENE_XY = Scene("sheet", (Axis("x", 0, 1), Axis("y", 0, 1)), (Phalanx("index", (0, 0)),))


def test_standard_columns_are_read_by_name(tmp_path):
    names = ["middle_1", "x", "stamp_s", "sweep", "y", "note"]
    names += [f"middle_{gauge}" for gauge in range(2, 9)] + GAUGES
    rng = np.random.default_rng(1)
    table = {name: rng.uniform(0, 1, 6) for name in names}
    table["stamp_s"] = [f"1700000000.{n}23456789" for n in (1, 2, 3, 1, 2, 3)]
    table["sweep"] = np.array([4, 4, 4, 0, 0, 0])
    table["note"] = ["1_a \u0661"] * 6
    rows = [[table[name][row] for name in names] for row in range(6)]
    recording = read_csv(write_csv(tmp_path / "a.csv", names, rows), SCENE)
    assert recording.notes == ()
    assert [sweep.number for sweep in recording.sweeps] == [4, 0]
    first = recording.sweeps[0]
    assert first.stamp_ns.tolist() == [1_700_000_000_023_456_789 + n * 10**8 for n in (1, 2, 3)]
    np.testing.assert_array_equal(first.position, np.column_stack([table["x"][:3], table["y"][:3]]))
    expected = [table[f"{phalanx}_{gauge}"][:3] for phalanx in ("index", "middle") for gauge in range(1, 9)]
    np.testing.assert_array_equal(first.strain, np.column_stack(expected))
    assert first.truth is None


def test_each_file_is_a_sweep(tmp_path):
    files = [write_csv(tmp_path / f"{name}.csv", HEADER, line_rows(3)) for name in "abc"]
    numbered = write_csv(tmp_path / "d.csv", [*HEADER, "sweep"], [[*row, 2] for row in line_rows(3)])
    assert [sweep.number for sweep in read_csv([*files, numbered], LINE).sweeps] == [1, 2, 3, 4]


def test_a_position_in_the_column_of_the_stamps_is_a_constant_speed(tmp_path):
    rows = [[row[0], *row[2:], sweep] for sweep in (1, 2) for row in line_rows(4)]
    rows += [[1000.0 + float(row[0]), *row[1:-1], 3] for row in rows[:4]]
    path = write_csv(tmp_path / "a.csv", ["time", *GAUGES, "sweep"], rows)
    naming = naming_from_pairs(["stamp_s=time", "x=time*0.5"], ColumnNaming())
    recording = read_csv(path, LINE, naming)
    assert recording.notes == ()
    for sweep in recording.sweeps:
        np.testing.assert_allclose(sweep.position[:, 0], [0, 0.005, 0.01, 0.015], atol=1e-12)


def test_poses_of_another_file_are_interpolated(tmp_path):
    rows = [[row[0], *row[2:]] for row in line_rows(20)]
    touch = write_csv(tmp_path / "touch.csv", ["stamp_s", *GAUGES], rows)
    rows = [[1035, 0.0], [1065, 0.006], [1035, 0.9], [1125, 0.0]]
    poses = write_csv(tmp_path / "poses.csv", ["t_ms", "x"], rows)
    naming = naming_from_pairs(["pose_stamp_s=t_ms*0.001"], ColumnNaming())
    recording = read_csv(touch, LINE, naming, poses=[poses])
    assert recording.notes[0] == f"skipped 1 of 4 rows of {poses} whose stamps do not increase"
    (sweep,) = recording.sweeps
    assert (sweep.gaps, len(sweep)) == (11, 9)
    np.testing.assert_allclose(1e3 * sweep.position[:3, 0], [1, 3, 5], atol=1e-9)
    with pytest.raises(ScanError, match="poses: expected 1 or 3 files beside 3, got 2"):
        read_csv([touch] * 3, LINE, naming, poses=[poses] * 2)


def test_poses_of_one_run_are_those_of_all_runs_of_the_strain(tmp_path):
    rows = [[f"{1 + at:.2f}", *range(8)] for at in (1.0, 1.1, 1.2, 0.1, 0.2, 0.3)]
    touch = write_csv(tmp_path / "touch.csv", ["stamp_s", *GAUGES], rows)
    poses = write_csv(
        tmp_path / "poses.csv", ["stamp_s", "x"], [[1 + 0.05 * n, 0.001 * n] for n in range(30)]
    )
    sweeps = read_csv(touch, LINE, poses=[poses]).sweeps
    assert [(len(each), each.gaps) for each in sweeps] == [(3, 0), (3, 0)]


def test_late_strain_is_of_the_place_and_the_sweep_where_it_was_felt(tmp_path):
    rows = [[f"{1 + 0.2 * n:.1f}", 1 + n // 5, *range(8)] for n in range(10)]
    touch = write_csv(tmp_path / "touch.csv", ["stamp_s", "sweep", *GAUGES], rows)
    rows = [[f"{0.5 + 0.05 * n:.2f}", 0.001 * n] for n in range(60)]
    poses = write_csv(tmp_path / "poses.csv", ["stamp_s", "x"], rows)
    sweeps = read_csv(touch, LINE, poses=[poses], delay_s=0.07).sweeps
    assert [(each.number, len(each), each.gaps) for each in sweeps] == [(1, 6, 0), (2, 4, 0)]
    felt_s = np.concatenate([each.stamp_ns for each in sweeps]) * 1e-9
    np.testing.assert_allclose(felt_s, 0.93 + 0.2 * np.arange(10))
    position = np.concatenate([each.position[:, 0] for each in sweeps])
    np.testing.assert_allclose(position, 0.02 * (felt_s - 0.5), atol=1e-12)


@pytest.mark.parametrize("delay_s", [0.3, -0.3])
def test_strain_felt_in_a_pause_is_of_the_sweep_of_its_rows(tmp_path, delay_s):
    """Rows only during sweeps, 4 s apart, while the poses go on."""
    rows = [[f"{8 * sweep + 0.01 * n:.2f}", sweep, *range(8)] for sweep in (1, 2, 3) for n in range(400)]
    touch = write_csv(tmp_path / "touch.csv", ["stamp_s", "sweep", *GAUGES], rows)
    rows = [[f"{0.02 * n:.2f}", 0.001 * n] for n in range(2000)]
    poses = write_csv(tmp_path / "poses.csv", ["stamp_s", "x"], rows)
    sweeps = read_csv(touch, LINE, poses=[poses], delay_s=delay_s).sweeps
    assert [(each.number, len(each), each.gaps) for each in sweeps] == [(1, 400, 0), (2, 400, 0), (3, 400, 0)]
    assert max(np.diff(each.stamp_ns).max() for each in sweeps) < 2e7


def test_an_angle_beyond_a_full_turn_is_within_the_bounds(tmp_path):
    scene = Scene("disc", (Axis("yaw", -np.pi, np.pi),), LINE.phalanges)
    path = write_csv(tmp_path / "a.csv", ["stamp_s", "yaw", *GAUGES], [[1, 6.0, *range(8)]])
    assert read_csv(path, scene).sweeps[0].position[0, 0] == pytest.approx(6.0 - 2 * np.pi)


@pytest.mark.parametrize("delimiter", [",", ";"])
@pytest.mark.parametrize(
    ("place", "cell", "problem"),
    [
        (0, "16:00:61", "column stamp_s: expected a number, found '16:00:61'"),
        (0, "2024-13-01 16:00:01", "column stamp_s: expected a number, found '2024-13-01 16:00:01'"),
        (1, "", "column x: expected a number, found an empty cell"),
        (1, "inf", "column x: expected a number, found 'inf'"),
        (4, "1,5", "column index_3: expected a number, found '1,5' (a decimal comma?"),
        (1, "NA", "column x: expected a number, found 'NA'"),
        (4, "1_000", "column index_3: expected a number, found '1_000'"),
        (0, "\u0661.5", "column stamp_s: expected a number, found '\u0661.5'"),  # an Arabic digit
        (4, "true", "column index_3: expected a number, found 'true'"),
        (4, "\x1b[31m", "column index_3: expected a number, found '\\x1b[31m'"),
        (4, "9" * 100, None),
        (slice(3, None), [], "expected 10 cells, found 3"),
    ],
)
def test_what_is_not_read_is_named_by_row_column_and_cell(tmp_path, place, cell, problem, delimiter):
    rows = line_rows(4)
    rows[2][place] = cell
    path = write_csv(tmp_path / "a.csv", HEADER, [*rows, rows[1]], delimiter=delimiter)
    recording = read_csv(path, LINE)
    expected = f"skipped 1 of 5 rows of {path} (first: line 4, {problem}" if problem else ""
    *unread, late = recording.notes
    assert "".join(unread).startswith(expected)
    valid = 4 - (problem is not None)
    assert late == f"skipped 1 of {valid + 1} rows of {path} whose stamps do not increase"
    assert (len(recording), recording.lost) == (valid, 5 - valid)


def test_stamps_that_jump_back_begin_another_sweep(tmp_path):
    rows = [[f"{0.01 * n:.2f}", 0.0001 * n, *range(8)] for n in (*range(75), *range(100), 98, 99, *range(60))]
    path = write_csv(tmp_path / "a.csv", HEADER, rows)
    recording = read_csv(path, LINE)
    assert [(each.number, len(each)) for each in recording.sweeps] == [(1, 75), (2, 100), (3, 60)]
    assert recording.notes == (
        f"skipped 2 of 237 rows of {path} whose stamps do not increase",
        f"2 of 237 rows of {path} have stamps that jump back: another run begins",
    )
    numbered = [[*row, 7 * (n > 120)] for n, row in enumerate(rows)]
    path = write_csv(tmp_path / "b.csv", [*HEADER, "sweep"], numbered)
    recording = read_csv(path, LINE)
    assert [(each.number, len(each)) for each in recording.sweeps] == [(0, 75), (1, 46), (7, 54), (8, 60)]


def test_numbers_of_sweeps_may_come_again_where_stamps_jump_back(tmp_path):
    session = [[0.01 * n, 0.0001 * n, *range(8), n // 20] for n in range(60)]
    path = write_csv(tmp_path / "a.csv", [*HEADER, "sweep"], session + session)
    recording = read_csv(path, LINE)
    assert [(each.number, len(each)) for each in recording.sweeps] == [(n, 20) for n in range(6)]
    shuffled = write_csv(
        tmp_path / "b.csv", [*HEADER, "sweep"], sorted(session, key=lambda row: row[0] % 0.2)
    )
    with pytest.raises(ScanError, match="expected the rows of each sweep together"):
        read_csv(shuffled, LINE)


@pytest.mark.parametrize(
    ("poses", "finding"),
    [
        (
            range(30),
            r"most of the strain is before or after all poses: strain from 0.*poses from 0.000 to 0.29",
        ),
        (range(100, 0, -1), "skipped 9[89] of 100 rows of .* whose stamps do not increase"),
    ],
    ids=["end early", "newest first"],
)
def test_poses_of_the_same_clock_are_not_to_be_shifted(tmp_path, poses, finding):
    path = write_csv(tmp_path / "a.csv", ["stamp_s", *GAUGES], [[0.01 * n, *range(8)] for n in range(100)])
    beside = write_csv(tmp_path / "b.csv", ["stamp_s", "x"], [[0.01 * n, 0.0001 * n] for n in poses])
    notes = "; ".join(read_csv(path, LINE, poses=[beside]).notes)
    assert re.search(finding, notes)
    assert "shifts" not in notes


@given(
    st.lists(st.sampled_from([10, 10, 10, 20, 5000, 0, -30, -400, -700, -60_000]), min_size=1, max_size=60),
    st.booleans(),
)
def test_sweeps_and_pairs_are_those_of_the_live_session(tmp_path_factory, steps_ms, apart):
    """Whatever the stamps do: repeat, overtake each other, pause, or jump back."""
    folder = tmp_path_factory.mktemp("stream")
    stamps_ms = 100_000 + np.cumsum(steps_ms)
    rows = [[f"{ms / 1e3:.3f}", f"{0.001 * n:.4f}", *range(8)] for n, ms in enumerate(stamps_ms.tolist())]
    session, live = Session(LINE.axes), []
    for ms, row in zip(stamps_ms.tolist(), rows, strict=True):
        session.add_pose(ms * 10**6, np.array([float(row[1])]))
        live += session.take()
        session.add_strain(ms * 10**6, None)
        live += session.take()
    live = [pair for pair in live + session.finish() if pair.position is not None]
    touch, poses = write_csv(folder / "a.csv", HEADER, rows), []
    if apart:
        poses = [write_csv(folder / "b.csv", HEADER[:2], [row[:2] for row in rows])]
    with suppress(ScanError):  # one row, or one stamp in all of them
        sweeps = read_csv(touch, LINE, poses=poses).sweeps
        assert [ns for sweep in sweeps for ns in sweep.stamp_ns.tolist()] == [pair.stamp_ns for pair in live]
        position = np.concatenate([sweep.position[:, 0] for sweep in sweeps])
        np.testing.assert_allclose(position, [pair.position[0] for pair in live], atol=1e-12)
        begins = sum(after.stamp_ns < before.stamp_ns for before, after in pairwise(live))
        assert len(sweeps) == 1 + begins


def test_series_merged_into_one_table_are_no_lost_rows(tmp_path):
    rows = [[row[0], "", *row[2:]] for row in line_rows(20)]
    poses = [[f"{1 + 0.004 * n:.3f}", 0.0004 * n, *[""] * 8] for n in range(48)]
    path = write_csv(tmp_path / "a.csv", HEADER, sorted([*rows, *poses], key=lambda row: float(row[0])))
    recording = read_csv(path, LINE, poses=[path])
    assert (recording.lost, recording.notes) == (0, ())
    np.testing.assert_allclose(recording.sweeps[0].position[:, 0], 0.001 * np.arange(19), atol=1e-12)
    assert "pass the file by --poses too" in read_csv(path, LINE).notes[0]


def test_rows_without_a_value_are_named_by_row_column_and_cell(tmp_path):
    """As pandas writes NaN, in a file of poses and in one of strain."""
    rows = [[row[0], *row[2:]] for row in line_rows(20)]
    rows[7][1:] = [""] * 8
    touch = write_csv(tmp_path / "touch.csv", ["stamp_s", *GAUGES], rows)
    places = [
        [row[0], *([""] * 2 if n in (3, 4) else [0.001 * n] * 2)] for n, row in enumerate(line_rows(20))
    ]
    poses = write_csv(tmp_path / "poses.csv", ["stamp_s", "x", "y"], places)
    notes = read_csv(touch, SCENE_XY, poses=[poses]).notes
    found = "expected a number, found an empty cell)"
    assert notes == (
        f"1 of 20 rows of {touch} have no value (first: line 9, column index_1: {found}",
        f"2 of 20 rows of {poses} have no value (first: line 5, column x: {found}",
    )


def test_a_column_without_any_number_is_to_be_left_out(tmp_path):
    rows = line_rows(6)
    for row in rows:
        row[4] = ""
    rows[2][5] = ""
    path = write_csv(tmp_path / "a.csv", HEADER, rows)
    assert read_csv(path, LINE).notes == (
        f"{path}: no number in any row of index_3: leave it out of the naming",
        f"{path}: no number in index_4 (1 of 6 rows)",
    )


def test_contact_may_be_true_or_false(tmp_path):
    felt = ["False", "TRUE", "1", "", "0"]
    rows = [[*row, cell] for row, cell in zip(line_rows(5), felt, strict=True)]
    (sweep,) = read_csv(write_csv(tmp_path / "a.csv", [*HEADER, "felt"], rows), LINE).sweeps
    assert sweep.felt.tolist() == [False, True, True, False, False]


def test_true_positions_beside_the_arms_are_the_truth(tmp_path):
    rows = [[*row, row[1] + 0.01] for row in line_rows(5)]
    path = write_csv(tmp_path / "a.csv", [*HEADER, "true_x"], rows)
    (sweep,) = read_csv(path, LINE).sweeps
    np.testing.assert_allclose(sweep.truth, sweep.position + 0.01)
    assert read_csv(path, SCENE_XY, naming_from_pairs(["y=x"], ColumnNaming())).sweeps[0].truth is None
    named = naming_from_pairs(["true_x=camera*0.001"], ColumnNaming())
    rows = [[*row, 5.0] for row in line_rows(5)]
    (sweep,) = read_csv(write_csv(tmp_path / "b.csv", [*HEADER, "camera"], rows), LINE, named).sweeps
    np.testing.assert_allclose(sweep.truth, 0.005)
    touch = write_csv(tmp_path / "c.csv", ["stamp_s", *GAUGES], [[row[0], *row[2:]] for row in line_rows(5)])
    poses = write_csv(tmp_path / "d.csv", ["stamp_s", "x", "true_x"], [["1", 0, 0.2], ["1.04", 0.004, 0.204]])
    (sweep,) = read_csv(touch, LINE, poses=[poses]).sweeps
    np.testing.assert_allclose(sweep.truth, sweep.position + 0.2)


def test_yaw_in_degrees_is_noticed_before_it_is_wrapped(tmp_path):
    scene = Scene("disc", (Axis("yaw", -np.pi, np.pi),), LINE.phalanges)
    rows = [[row[0], 0.37 * n, *row[2:]] for n, row in enumerate(line_rows(100))]
    path = write_csv(tmp_path / "a.csv", ["stamp_s", "heading", *GAUGES], rows)
    poses = write_csv(tmp_path / "b.csv", ["stamp_s", "heading"], [row[:2] for row in rows])
    naming = naming_from_pairs(["yaw=heading"], ColumnNaming())
    for beside in ([], [poses]):
        (note,) = read_csv(path, scene, naming, poses=beside).notes
        assert "yaw is 0 to 36.63 rad: in degrees? --column yaw=heading*0.0174533" in note
    naming = naming_from_pairs(["yaw=heading*0.0174533"], ColumnNaming())
    assert read_csv(path, scene, naming).notes == ()
    around = write_csv(tmp_path / "c.csv", ["stamp_s", "yaw"], [[row[0], 0.1 * row[1] - 1.8] for row in rows])
    assert not read_csv(path, scene, poses=[around]).notes
    rows = [[row[0], 0.1 * n - 5.0] for n, row in enumerate(rows)]
    around = write_csv(tmp_path / "c.csv", ["stamp_s", "yaw"], rows)
    (note,) = read_csv(path, scene, poses=[around]).notes
    assert "yaw is -5 to 4.9 rad: in degrees?" in note
    true = write_csv(
        tmp_path / "d.csv", ["stamp_s", "yaw", "true_yaw"], [[row[0], 0.0, row[1]] for row in rows]
    )
    (note,) = read_csv(path, scene, poses=[true]).notes
    assert "true_yaw is -5 to 4.9 rad: in degrees? --column true_yaw=true_yaw*0.0174533" in note


def test_poses_of_two_sources_are_noticed(tmp_path):
    touch = write_csv(
        tmp_path / "a.csv", ["stamp_s", *GAUGES], [[row[0], *row[2:]] for row in line_rows(100)]
    )
    rows = [[row[0], row[1] + 0.02 * (n % 2)] for n, row in enumerate(line_rows(100))]
    (note,) = read_csv(touch, LINE, poses=[write_csv(tmp_path / "b.csv", ["stamp_s", "x"], rows)]).notes
    assert "two sources" in note


@pytest.mark.parametrize("factor", [1e3, 1e9, 1e-3, 1e-6])
def test_an_implausible_period_is_reported_with_other_units(tmp_path, factor):
    rows = [[factor * 0.005 * n + 1, *row[1:]] for n, row in enumerate(line_rows(20))]
    note = read_csv(write_csv(tmp_path / "a.csv", HEADER, rows), LINE).notes[0]
    assert "s apart (another unit? --column stamp_s=stamp_s*0.001 for ms" in note


@pytest.mark.parametrize("clock", ["since 1970", "irregular", "of the poses"])
def test_points_at_rest_are_not_in_another_unit(tmp_path, clock):
    rng = np.random.default_rng(4)
    seconds = 3.0 * np.arange(40) + 1.7e9 * (clock == "since 1970")
    seconds += np.cumsum(rng.uniform(0, 4, 40)) * (clock == "irregular")
    rows = [[f"{second:.3f}", *row[1:]] for second, row in zip(seconds, line_rows(40), strict=True)]
    poses = []
    if clock == "of the poses":
        place = [[0.02 * n, 0.001 * n] for n in range(6000)]
        poses = [write_csv(tmp_path / "poses.csv", ["stamp_s", "x"], place)]
    assert "unit" not in "".join(
        read_csv(write_csv(tmp_path / "a.csv", HEADER, rows), LINE, poses=poses).notes
    )


@pytest.mark.parametrize("each", [10, 3])
def test_stamps_of_a_coarse_clock_are_reported_as_such(tmp_path, each):
    rows = [[f"{n // each / 100:.2f}", *row[1:]] for n, row in enumerate(line_rows(900))]
    path = write_csv(tmp_path / "a.csv", HEADER, rows)
    notes = read_csv(path, LINE).notes
    assert notes[-1].startswith(
        f"{path}: {900 - 900 // each} of 900 rows have the stamp of the row before: a clock of 0.01 s"
    )
    assert "apart (another unit" not in notes[-1]
    naming = naming_from_pairs([notes[-1].split("'")[1]], ColumnNaming())
    recording = read_csv(path, LINE, naming)
    assert (len(recording), recording.notes) == (900, ())
    assert recording.sweeps[0].stamp_ns[-1] == pytest.approx(9e9 / each, abs=2e7)
