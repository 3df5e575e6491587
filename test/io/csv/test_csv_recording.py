"""CSV files are read by the names of their columns; invalid rows are skipped, counted and reported."""

import csv
import gzip
import os
import time
from contextlib import suppress
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_localizer.errors import ScanError
from tactile_localizer.io.csv.columns import (
    ColumnNaming,
    load_naming,
    naming_from_dict,
    naming_from_pairs,
    naming_to_dict,
)
from tactile_localizer.io.csv.proposal import propose_scene
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.status import MISSING
from tactile_localizer.scene import Axis, Phalanx, Scene
from tactile_localizer.streams.synchronization import Pairing, interpolate_poses

SCENE = Scene(
    "bump", (Axis("x", 0, 1), Axis("y", 0, 1)), (Phalanx("index", (0, 0)), Phalanx("middle", (0, 0)))
)
LINE = Scene("line", (Axis("x", 0, 1),), (Phalanx("index", (0,)),))
SCENE_XY = Scene("sheet", (Axis("x", 0, 1), Axis("y", 0, 1)), (Phalanx("index", (0, 0)),))
GAUGES = [f"index_{gauge}" for gauge in range(1, 9)]
HEADER = ["stamp_s", "x", *GAUGES]


def write(path, header, rows, **options):
    with path.open("w", newline="") as file:
        csv.writer(file, **options).writerows([header, *rows])
    return path


def line_rows(n):
    return [
        [f"{1.0 + 0.01 * row:.2f}", 0.001 * row, *(row + gauge / 10 for gauge in range(8))]
        for row in range(n)
    ]


def test_standard_columns_are_read_by_name(tmp_path):
    names = ["middle_1", "x", "stamp_s", "sweep", "y", "note"]
    names += [f"middle_{gauge}" for gauge in range(2, 9)] + GAUGES
    rng = np.random.default_rng(1)
    table = {name: rng.uniform(0, 1, 6) for name in names}
    table["stamp_s"] = [f"1700000000.{n}23456789" for n in (1, 2, 3, 1, 2, 3)]
    table["sweep"] = np.array([4, 4, 4, 0, 0, 0])
    table["note"] = ["1_a \u0661"] * 6
    rows = [[table[name][row] for name in names] for row in range(6)]
    recording = read_csv(write(tmp_path / "a.csv", names, rows), SCENE)
    assert recording.notes == ()
    assert [sweep.number for sweep in recording.sweeps] == [4, 0]
    first = recording.sweeps[0]
    assert first.stamp_ns.tolist() == [1_700_000_000_023_456_789 + n * 10**8 for n in (1, 2, 3)]
    np.testing.assert_array_equal(first.position, np.column_stack([table["x"][:3], table["y"][:3]]))
    expected = [table[f"{phalanx}_{gauge}"][:3] for phalanx in ("index", "middle") for gauge in range(1, 9)]
    np.testing.assert_array_equal(first.strain, np.column_stack(expected))
    assert first.truth is None


def test_each_file_is_a_sweep(tmp_path):
    files = [write(tmp_path / f"{name}.csv", HEADER, line_rows(3)) for name in "abc"]
    numbered = write(tmp_path / "d.csv", [*HEADER, "sweep"], [[*row, 2] for row in line_rows(3)])
    assert [sweep.number for sweep in read_csv([*files, numbered], LINE).sweeps] == [1, 2, 3, 4]


def test_a_position_in_the_column_of_the_stamps_is_a_constant_speed(tmp_path):
    rows = [[row[0], *row[2:], sweep] for sweep in (1, 2) for row in line_rows(4)]
    path = write(tmp_path / "a.csv", ["time", *GAUGES, "sweep"], rows)
    naming = naming_from_pairs(["stamp_s=time", "x=time*0.5"], ColumnNaming())
    for sweep in read_csv(path, LINE, naming).sweeps:
        np.testing.assert_allclose(sweep.position[:, 0], [0, 0.005, 0.01, 0.015], atol=1e-12)


def test_poses_of_another_file_are_interpolated_as_live(tmp_path):
    touch = write(tmp_path / "touch.csv", ["stamp_s", *GAUGES], [[row[0], *row[2:]] for row in line_rows(20)])
    pose_s = np.arange(1.035, 1.15, 0.03)
    rows = [[f"{1e3 * t:.3f}", (t - 1.0) ** 2] for t in pose_s]
    rows.insert(2, [rows[1][0], 0.9])
    poses = write(tmp_path / "poses.csv", ["t_ms", "x"], rows)
    naming = naming_from_pairs(["pose_stamp_s=t_ms*0.001"], ColumnNaming())
    recording = read_csv(touch, LINE, naming, poses=[poses])
    assert recording.notes == (f"skipped 1 of 5 rows of {poses} whose stamps do not increase",)
    (sweep,) = recording.sweeps
    pose_ns, place = np.rint(pose_s * 1e9).astype(int), ((pose_s - 1.0) ** 2)[:, None]
    stamp_ns = 10**9 + 10**7 * np.arange(20)
    expected, found = interpolate_poses(LINE.axes, pose_ns, place, stamp_ns)
    assert (sweep.gaps, len(sweep)) == (20 - found.sum(), found.sum())
    np.testing.assert_allclose(sweep.position, expected[found], atol=1e-9)
    with pytest.raises(ScanError, match="poses: expected 1 or 3 files beside 3, got 2"):
        read_csv([touch] * 3, LINE, naming, poses=[poses] * 2)


def test_an_angle_beyond_a_full_turn_is_within_the_bounds(tmp_path):
    scene = Scene("disc", (Axis("yaw", -np.pi, np.pi),), LINE.phalanges)
    path = write(tmp_path / "a.csv", ["stamp_s", "yaw", *GAUGES], [[1, 6.0, *range(8)]])
    assert read_csv(path, scene).sweeps[0].position[0, 0] == pytest.approx(6.0 - 2 * np.pi)


def test_columns_can_be_named(tmp_path):
    (tmp_path / "naming.yaml").write_text(
        "stamp_s: time * 0.001\nx: [pos_mm]\nindex: gauge1..8 * 0.5\nstrain_unit: counts\n"
    )
    naming = naming_from_pairs(["x=pos_mm*1e-3"], load_naming(tmp_path / "naming.yaml"))
    assert naming.strain_unit == "counts"
    assert naming_from_dict(naming_to_dict(naming)) == naming
    header = ["time", "pos_mm", *(f"gauge{gauge}" for gauge in range(1, 9))]
    path = write(tmp_path / "a.csv", header, [[2500, 7, *range(8)]])
    sweep = read_csv(path, LINE, naming).sweeps[0]
    assert sweep.stamp_ns[0] == 2_500_000_000
    np.testing.assert_allclose(sweep.position, [[0.007]])
    np.testing.assert_allclose(sweep.strain, [np.arange(8) / 2])
    assert sweep.strain_unit == "counts"
    listed = naming_from_pairs(["index=" + ",".join(header[2:]), "stamp_s=time", "x=pos_mm"], ColumnNaming())
    np.testing.assert_allclose(read_csv(path, LINE, listed).sweeps[0].strain, [np.arange(8)])


def test_more_channels_than_the_scene_has_are_refused(tmp_path):
    header = ["stamp_s", "x", *(f"index_{n}" for n in range(1, 20))]
    path = write(tmp_path / "a.csv", header, [[1, 0, *range(19)]])
    for naming in (ColumnNaming(), naming_from_pairs(["index=index_1..19"], ColumnNaming())):
        with pytest.raises(
            ScanError, match=r"expected 8 channels for phalanx index .* found 19 .* write channels: 19"
        ):
            read_csv(path, LINE, naming)


def test_invalid_rows_are_counted(tmp_path):
    rows = line_rows(12)
    rows[2][0], rows[3][4], rows[4], rows[5][1] = "late", "high", rows[4][:3], "nan"
    rows[6][0], rows[7][4], rows[8][0] = rows[1][0], "1_000", "\u0661.5"  # an Arabic digit
    path = write(tmp_path / "a.csv", HEADER, rows)
    path.write_text("# recorded by hand\n\n" + path.read_text())
    recording = read_csv(path, LINE)
    assert (len(recording), recording.lost) == (5, 7)
    first = "line 6, column stamp_s: expected a number, found 'late'"
    assert recording.notes == (
        f"skipped 6 of 12 rows of {path} (first: {first})",
        f"skipped 1 of 6 rows of {path} whose stamps do not increase",
    )


@pytest.mark.parametrize(
    ("place", "cell", "problem"),
    [
        (0, "16:00:01", "column stamp_s: expected a number, found '16:00:01'"),
        (0, "2024-13-01 16:00:01", "column stamp_s: expected a number, found '2024-13-01 16:00:01'"),
        (1, "", "column x: expected a number, found an empty cell"),
        (1, "inf", "column x: expected a number, found 'inf'"),
        (4, "1,5", "column index_3: expected a number, found '1,5' (a decimal comma?"),
        (1, "NA", "column x: expected a number, found 'NA'"),
        (4, "true", "column index_3: expected a number, found 'true'"),
        (4, "\x1b[31m", "column index_3: expected a number, found '\\x1b[31m'"),
        (4, "9" * 100, None),
        (slice(3, None), [], "expected 10 cells, found 3"),
    ],
)
def test_what_is_not_read_is_named_by_row_column_and_cell(tmp_path, place, cell, problem):
    rows = line_rows(4)
    rows[2][place] = cell
    path = write(tmp_path / "a.csv", HEADER, rows)
    recording = read_csv(path, LINE)
    expected = f"skipped 1 of 4 rows of {path} (first: line 4, {problem}" if problem else ""
    assert "".join(recording.notes).startswith(expected)
    assert len(recording) == 4 - (problem is not None)


def test_nan_marks_only_its_phalanx_missing(tmp_path):
    names = ["stamp_s", "x", "y", *GAUGES, *(f"middle_{gauge}" for gauge in range(1, 9))]
    rows = [[1, 0, 0, *range(16)], [1.1, 0, 0, *range(16)]]
    rows[1][3 + 9], rows[0][3] = "nan", "inf"
    sweep = read_csv(write(tmp_path / "a.csv", names, rows), SCENE).sweeps[0]
    np.testing.assert_array_equal(sweep.status, [[MISSING, 0], [0, MISSING]])
    np.testing.assert_array_equal(np.isnan(sweep.strain).sum(axis=1), [1, 1])


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_delimiters_quotes_byte_order_marks_and_gzip_are_read(tmp_path, delimiter):
    rows = [[f'"{cell}"' if n else cell for n, cell in enumerate(row)] for row in line_rows(4)]
    text = "\r\n".join(delimiter.join(map(str, row)) for row in [[" stamp_s", *HEADER[1:]], *rows, [""]])
    for content in (text.encode("utf-8-sig"), gzip.compress(text.encode())):
        (tmp_path / "a.csv").write_bytes(content)
        recording = read_csv(tmp_path / "a.csv", LINE)
        assert recording.notes == ()
        np.testing.assert_allclose(recording.sweeps[0].position[:, 0], [0, 0.001, 0.002, 0.003])


def as_text(header=HEADER, rows=None, separator=","):
    return "\n".join(separator.join(map(str, row)) for row in [header, *(rows or line_rows(4))]) + "\n"


def assert_four_rows(recording):
    assert recording.notes == ()
    assert recording.lost == 0
    (sweep,) = recording.sweeps
    assert sweep.stamp_ns.tolist() == [1_000_000_000, 1_010_000_000, 1_020_000_000, 1_030_000_000]
    np.testing.assert_allclose(sweep.position[:, 0], [0, 0.001, 0.002, 0.003])
    np.testing.assert_allclose(sweep.strain[:, 1], [0.1, 1.1, 2.1, 3.1])


@pytest.mark.parametrize(
    "text",
    [
        "# " + as_text(),
        "% " + as_text(separator="\t"),
        "#" + as_text(separator=" "),
        "# " + as_text(separator="  ").replace("\n", "  \n  "),
        "# by hand, on Monday, with care\n# " + as_text(),
        "# by hand, on Monday, with care\n" + as_text(),
        "# stamp_s: s, x: m\n" + as_text() + "# the end\n",
        "sep=;\n" + as_text(separator=";"),
        "Viewer 2.19; 12 May 2026\nOperator;n.n.\nStep No. 1\nVelocity = 40\n\n" + as_text(),
        "\n".join(f"Key {n},value,{n}" for n in range(30)) + "\n" + as_text(separator=";"),
        as_text(rows=[["s", "m", *"V" * 8], ["float"] * 10, *line_rows(4)]),
        as_text(rows=[*line_rows(2), HEADER, *line_rows(4)[2:]]),
        as_text([f" {name} " for name in HEADER]),
        as_text([f'"{name}"' for name in HEADER], separator="; "),
        as_text().replace("\n", "\r"),
        as_text().replace("\n", "\r\n\r\n"),
        as_text(separator=";").replace(".", ","),
        as_text(separator="\t").replace(".", ","),
        as_text(separator="\t").replace(".", ",").replace("\n", "\t\n"),
        as_text([*HEADER, "Comment"], separator="\t").replace(".", ","),
    ],
)
def test_header_separator_and_decimal_sign_are_found(tmp_path, text):
    (tmp_path / "a.csv").write_text(text, newline="")
    assert_four_rows(read_csv(tmp_path / "a.csv", LINE))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_names_of_any_encoding_are_found(tmp_path, encoding):
    header = ["stamp_s", "Weg [µm]", *HEADER[2:]]
    content = as_text(header, [[row[0], 1e6 * row[1], *row[2:]] for row in line_rows(4)]).encode(encoding)
    naming = naming_from_pairs(["x=Weg [µm]*1e-6"], ColumnNaming())
    for stored in (content, gzip.compress(content)):
        (tmp_path / "a.csv").write_bytes(stored)
        assert_four_rows(read_csv(tmp_path / "a.csv", LINE, naming))


def test_thousands_beside_decimal_points_are_not_taken_for_decimal_commas(tmp_path):
    rows = line_rows(4)
    rows[2][4] = "1,002"
    path = write(tmp_path / "a.csv", HEADER, rows, delimiter=";")
    recording = read_csv(path, LINE)
    assert recording.notes == (
        f"skipped 1 of 4 rows of {path} (first: line 4, column index_3: expected a number, found '1,002' "
        "(a decimal comma? write points, or separate by semicolons))",
    )


def test_names_with_commas_and_signs_can_be_given(tmp_path):
    forces = [f"Force {n}, N" for n in range(1, 9)]
    header = ["time, s", "x-2, mm * rel", *forces]
    rows = [[row[0], 1e3 * row[1], *row[2:]] for row in line_rows(4)]
    path = write(tmp_path / "a.csv", header, rows)
    naming = {"stamp_s": ["time, s"], "x": ["x-2, mm * rel"], "index": forces}
    sweep = read_csv(path, Scene("mm", (Axis("x", 0, 4),), LINE.phalanges), naming_from_dict(naming)).sweeps[
        0
    ]
    np.testing.assert_allclose(sweep.position[:, 0], [0, 1, 2, 3])
    path = write(tmp_path / "b.csv", [header[0], "x-2, mm", *forces], rows)
    assert_four_rows(read_csv(path, LINE, naming_from_dict({**naming, "x": "x-2, mm * 0.001"})))
    assert naming_from_dict(naming_to_dict(naming_from_dict(naming))) == naming_from_dict(naming)


@pytest.mark.parametrize(
    ("column", "cells"),
    [
        ("sec + nanosec * 1e-9", lambda n: (1, 10_000_000 * n)),
        ("sec+nanosec*1e-9-1732550400", lambda n: (1_732_550_401, 10_000_000 * n)),
        ("nanosec*1e-9 + 1", lambda n: (7, 10_000_000 * n)),
        ("nanosec * 1e-9 - 1.5e3", lambda n: (7, 1_501_000_000_000 + 10_000_000 * n)),
        ("sec", lambda n: (f"1970-01-01 00:00:01.{10 * n:03}", 0)),
        ("sec", lambda n: (f"1970-01-01T02:00:01.{10 * n:03}000000+02:00", 0)),
        ("sec", lambda n: (f"1969-12-31T20:30:01.{10 * n:03}-0330", 0)),
        ("sec", lambda n: (f"1970-01-01 00:00:01.{1e4 * n:06.0f} UTC", 0)),
        ("sec-1732550400", lambda n: (f"2024-11-25 16:00:01.{10 * n:03}Z", 0)),
    ],
)
def test_stamps_may_be_sums_shifted_and_dates(tmp_path, column, cells):
    rows = [[*cells(n), *row[1:]] for n, row in enumerate(line_rows(4))]
    path = write(tmp_path / "a.csv", ["sec", "nanosec", *HEADER[1:]], rows)
    assert_four_rows(read_csv(path, LINE, naming_from_pairs([f"stamp_s={column}"], ColumnNaming())))


def test_stamps_that_jump_back_begin_another_sweep(tmp_path):
    rows = [[f"{0.01 * n:.2f}", 0.0001 * n, *range(8)] for n in (*range(75), *range(100), 98, 99, *range(60))]
    path = write(tmp_path / "a.csv", HEADER, rows)
    recording = read_csv(path, LINE)
    assert [(each.number, len(each)) for each in recording.sweeps] == [(1, 75), (2, 100), (3, 60)]
    assert recording.notes == (
        f"skipped 2 of 237 rows of {path} whose stamps do not increase",
        f"{path}: 2 of 237 stamps jump back, where another sweep begins",
    )
    numbered = [[*row, 7 * (n > 120)] for n, row in enumerate(rows)]
    path = write(tmp_path / "b.csv", [*HEADER, "sweep"], numbered)
    recording = read_csv(path, LINE)
    assert [(each.number, len(each)) for each in recording.sweeps] == [(0, 75), (1, 46), (7, 54), (8, 60)]
    touch = write(tmp_path / "c.csv", ["stamp_s", *GAUGES], [[row[0], *row[2:]] for row in rows])
    poses = write(tmp_path / "d.csv", ["stamp_s", "x"], [row[:2] for row in rows])
    paired = read_csv(touch, LINE, poses=[poses])
    assert [len(each) for each in paired.sweeps] == [75, 100, 60]
    np.testing.assert_allclose(paired.sweeps[1].position[:, 0], 0.0001 * np.arange(100), atol=1e-12)


@settings(deadline=None)
@given(
    st.lists(st.sampled_from([10, 10, 10, 20, 5000, 0, -30, -400, -700, -60_000]), min_size=1, max_size=60),
    st.booleans(),
)
def test_sweeps_and_pairs_are_those_of_the_live_pairing(tmp_path_factory, steps_ms, apart):
    """Whatever the stamps do: repeat, overtake each other, pause, or jump back."""
    folder = tmp_path_factory.mktemp("stream")
    stamps_ms = 100_000 + np.cumsum(steps_ms)
    rows = [[f"{ms / 1e3:.3f}", f"{0.001 * n:.4f}", *range(8)] for n, ms in enumerate(stamps_ms.tolist())]
    pairing, live = Pairing(LINE.axes), []
    for ms, row in zip(stamps_ms.tolist(), rows, strict=True):
        live += pairing.add_pose(ms * 10**6, np.array([float(row[1])]))
        live += pairing.add_strain(ms * 10**6, None)
    live = [pair for pair in live + pairing.finish() if pair.position is not None]
    touch, poses = write(folder / "a.csv", HEADER, rows), []
    if apart:
        poses = [write(folder / "b.csv", HEADER[:2], [row[:2] for row in rows])]
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
    path = write(tmp_path / "a.csv", HEADER, sorted([*rows, *poses], key=lambda row: float(row[0])))
    recording = read_csv(path, LINE, poses=[path])
    assert (recording.lost, recording.notes) == (0, ())
    np.testing.assert_allclose(recording.sweeps[0].position[:, 0], 0.001 * np.arange(19), atol=1e-12)
    assert "pass the file by --poses too" in read_csv(path, LINE).notes[0]


@pytest.mark.parametrize(
    "spelling", ["", " ", "nan", "NaN", "-nan", "NA", "N/A", "#N/A", "null", "None", "-"]
)
def test_a_strain_that_is_missing_is_nan_in_any_spelling(tmp_path, spelling):
    rows = line_rows(4)
    rows[1][4] = rows[2][4] = rows[3][5] = spelling
    path = write(tmp_path / "a.csv", HEADER, rows)
    recording = read_csv(path, LINE)
    (sweep,) = recording.sweeps
    np.testing.assert_array_equal(np.isnan(sweep.strain[:, 2:4]), [[0, 0], [1, 0], [1, 0], [0, 1]])
    assert sweep.status[:, 0].tolist() == [0, MISSING, MISSING, MISSING]
    assert recording.notes == (f"{path}: no number in index_3 (2 of 4 rows), index_4 (1 of 4 rows)",)


def test_contact_may_be_true_or_false(tmp_path):
    felt = ["False", "TRUE", "1", "", "0"]
    rows = [[*row, cell] for row, cell in zip(line_rows(5), felt, strict=True)]
    (sweep,) = read_csv(write(tmp_path / "a.csv", [*HEADER, "felt"], rows), LINE).sweeps
    assert sweep.felt.tolist() == [False, True, True, False, False]


def test_true_positions_beside_the_arms_are_the_truth(tmp_path):
    rows = [[*row, row[1] + 0.01] for row in line_rows(5)]
    path = write(tmp_path / "a.csv", [*HEADER, "true_x"], rows)
    (sweep,) = read_csv(path, LINE).sweeps
    np.testing.assert_allclose(sweep.truth, sweep.position + 0.01)
    assert read_csv(path, SCENE_XY, naming_from_pairs(["y=x"], ColumnNaming())).sweeps[0].truth is None
    named = naming_from_pairs(["true_x=camera*0.001"], ColumnNaming())
    rows = [[*row, 5.0] for row in line_rows(5)]
    (sweep,) = read_csv(write(tmp_path / "b.csv", [*HEADER, "camera"], rows), LINE, named).sweeps
    np.testing.assert_allclose(sweep.truth, 0.005)
    touch = write(tmp_path / "c.csv", ["stamp_s", *GAUGES], [[row[0], *row[2:]] for row in line_rows(5)])
    poses = write(tmp_path / "d.csv", ["stamp_s", "x", "true_x"], [["1", 0, 0.2], ["1.04", 0.004, 0.204]])
    (sweep,) = read_csv(touch, LINE, poses=[poses]).sweeps
    np.testing.assert_allclose(sweep.truth, sweep.position + 0.2)


@pytest.mark.parametrize(
    "name", ["x_1", "y_1", "yaw_1", "stamp_s_1", "sweep_1", "felt_1", "true_x_1", "foo_1"]
)
def test_a_numbered_column_of_no_phalanx_is_ignored(tmp_path, name):
    rows = [[*row, 5.0] for row in line_rows(4)]
    assert_four_rows(read_csv(write(tmp_path / "a.csv", [*HEADER, name], rows), LINE))


def test_a_phalanx_with_the_name_of_another_quantity_is_refused(tmp_path):
    scene = Scene("odd", LINE.axes, (Phalanx("x", (0,)),))
    with pytest.raises(ScanError, match="phalanx x: expected a name other than stamp_s"):
        read_csv(write(tmp_path / "a.csv", HEADER, line_rows(4)), scene)


def test_yaw_in_degrees_is_noticed_before_it_is_wrapped(tmp_path):
    scene = Scene("disc", (Axis("yaw", -np.pi, np.pi),), LINE.phalanges)
    rows = [[row[0], 0.37 * n, *row[2:]] for n, row in enumerate(line_rows(100))]
    path = write(tmp_path / "a.csv", ["stamp_s", "heading", *GAUGES], rows)
    poses = write(tmp_path / "b.csv", ["stamp_s", "heading"], [row[:2] for row in rows])
    naming = naming_from_pairs(["yaw=heading"], ColumnNaming())
    for beside in ([], [poses]):
        (note,) = read_csv(path, scene, naming, poses=beside).notes
        assert "yaw is 0 to 36.63 rad: in degrees? --column yaw=heading*0.0174533" in note
    naming = naming_from_pairs(["yaw=heading*0.0174533"], ColumnNaming())
    assert read_csv(path, scene, naming).notes == ()


def test_poses_of_another_clock_or_of_two_sources_are_noticed(tmp_path):
    touch = write(tmp_path / "a.csv", ["stamp_s", *GAUGES], [[row[0], *row[2:]] for row in line_rows(100)])
    poses = write(
        tmp_path / "b.csv", ["stamp_s", "x"], [[3600 + float(row[0]), row[1]] for row in line_rows(100)]
    )
    recording = read_csv(touch, LINE, poses=[poses])
    assert f"{poses}: the poses are 3600 s ahead of the strain, another clock?" in recording.notes[0]
    assert recording.notes[1] == "--column pose_stamp_s=stamp_s-SECONDS shifts the poses"
    assert recording.sweeps[0].gaps == 100
    naming = naming_from_pairs(["pose_stamp_s=stamp_s-3600"], ColumnNaming())
    assert read_csv(touch, LINE, naming, poses=[poses]).notes == ()
    rows = [[row[0], row[1] + 0.02 * (n % 2)] for n, row in enumerate(line_rows(100))]
    (note,) = read_csv(touch, LINE, poses=[write(tmp_path / "c.csv", ["stamp_s", "x"], rows)]).notes
    assert "two sources" in note
    rows = line_rows(101)[::20]
    (note,) = read_csv(touch, LINE, poses=[write(tmp_path / "d.csv", HEADER, rows)]).notes
    assert "--max-gap 0.3" in note


@pytest.mark.parametrize("factor", [1e3, 1e9, 1e-3, 1e-6])
def test_an_implausible_period_is_reported_with_other_units(tmp_path, factor):
    rows = [[factor * 0.005 * n + 1, *row[1:]] for n, row in enumerate(line_rows(20))]
    note = read_csv(write(tmp_path / "a.csv", HEADER, rows), LINE).notes[0]
    assert "s apart (another unit? --column stamp_s=stamp_s*0.001 for ms" in note


HEAD = ",".join(HEADER) + "\n"
SWEEPS = ",".join(["sweep", *HEADER]) + "\n"
ROW = ",0" + ",1" * 8 + "\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "expected a CSV file, No such file"),
        ("", "expected a column for stamp_s .*, found no header"),
        ("stamp_s,x\n1,2\n", "expected a column for index .*, found stamp_s, x; .* --column index=NAME1..8"),
        (b"\xff\xfd\x00\x80" * 50, "expected a CSV file, found one that is no text"),
        (b"PK\x03\x04\x14\x00\x06", r"expected a CSV file, found one that is no text \(a spreadsheet"),
        ("stamp_s\n".encode("utf-16"), "expected a column for x .*, found stamp_s"),
        (HEAD + ("0" + ROW) * 3, "expected stamps that increase, found 0 s in all 3 rows"),
        (b"\x1f\x8b\x08", "expected a CSV file, Compressed file ended"),
        (HEAD, "expected rows of numbers, found none in 0 rows"),
        (HEAD + "a" + ROW, "found none in 1 rows .line 2, column stamp_s: expected a number, found 'a'"),
        (HEAD + "1,0" + ",5" * 16, "line 2: expected 10 cells as in the header, found 18 .decimal commas"),
        (
            HEAD + "1.7e12" + ROW,
            r"a stamp in s, found 1.7e\+12 .another unit\? --column stamp_s=stamp_s\*0.001",
        ),
        (HEAD + "17e17" + ROW, r"found 1.7e\+18 \(another unit\? .* \*1e-9 for ns"),
        ("x," + HEAD, "expected one column 'x', found 2"),
        (SWEEPS + "0.5,0" + ROW, "whole numbers in the column of the sweeps, found 0.5"),
        (SWEEPS + "-1,0" + ROW, "whole numbers in the column of the sweeps, found -1"),
        (SWEEPS + "".join(f"{n % 2},{n}{ROW}" for n in range(3)), "together, found sweeps 0, 1, 0"),
    ],
)
def test_unusable_files_are_refused(tmp_path, content, message):
    path = tmp_path / "a.csv"
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ScanError, match=message) as refusal:
        read_csv(path, LINE)
    assert str(refusal.value).startswith(str(path))
    assert "\n" not in str(refusal.value)


def test_what_would_never_end_or_fill_the_memory_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", "/dev/zero", tmp_path):
        with pytest.raises(ScanError, match=r"expected a CSV file, found (no regular file|a directory)"):
            read_csv(path, LINE)
    with gzip.open(tmp_path / "bomb.csv.gz", "wt") as file:
        file.write(HEAD + "0" * 2**25)
    with pytest.raises(ScanError, match="expected lines of less than 1048576 characters"):
        read_csv(tmp_path / "bomb.csv.gz", LINE)
    with gzip.open(tmp_path / "many.csv.gz", "wb", 1) as file:
        file.write(HEAD.encode() + b"0,0,1,1,1,1,1,1,1,1\n" * 4_000_000)
    begun_s = time.monotonic()
    with pytest.raises(ScanError, match=r"expected at most \d+ rows, found \d+; split it by sweeps"):
        read_csv(tmp_path / "many.csv.gz", LINE)
    assert time.monotonic() - begun_s < 5
    (tmp_path / "wide.csv").write_text(",".join(f"c{n}c" for n in range(10**5)) + "\n")
    with pytest.raises(ScanError, match="and 99980 more") as refusal:
        read_csv(tmp_path / "wide.csv", LINE)
    assert len(str(refusal.value)) < 1000


@pytest.mark.parametrize("repeated", ["1", "_", " ", "1,", "-", "a1."])
@pytest.mark.parametrize("place", ["header", "row", "naming"])
def test_long_cells_take_no_longer_than_others(tmp_path, repeated, place):
    cell = repeated * 50_000 + "x"
    header, rows, naming = [*HEADER, "more"], [[*row, ""] for row in line_rows(4)], ColumnNaming()
    begun_s = time.process_time()
    with suppress(ScanError):
        if place == "header":
            header[-1] = cell
        elif place == "row":
            rows[2][0] = cell
        else:
            naming = naming_from_pairs([f"stamp_s={cell}", f"index={cell}"], naming)
        path = write(tmp_path / "a.csv", header, rows, delimiter="\t")
        assert len(read_csv(path, LINE, naming)) == 4 - (place == "row")
    with suppress(ScanError):
        propose_scene("own", [str(write(tmp_path / "b.csv", header[:1] + header[-1:], rows))], naming)
    assert time.process_time() - begun_s < 2


@given(
    st.lists(
        st.tuples(st.sampled_from(["stamp_s", "pose_stamp_s", "x", "index"]), st.text(min_size=1)), max_size=3
    )
)
def test_any_naming_is_read_back_or_refused(pairs):
    with suppress(ScanError):
        naming = naming_from_pairs([f"{name}={text}" for name, text in pairs], ColumnNaming())
        assert naming_from_dict(naming_to_dict(naming)) == naming


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        (["x"], "expected QUANTITY=COLUMN"),
        (["x=a*b"], "'x': expected a number after"),
        (["x=a*nan"], "'x': expected a number after"),
        (["x=a*0"], "'x': expected a number after .* other than 0, got '0'"),
        (["thumb=g1..8"], "'thumb': expected one of stamp_s, pose_stamp_s, sweep, felt, x, true_x, index"),
        (["index=g1..999999999"], "'index': expected 1 to 4096 columns"),
        (["x=a1..2"], "'x': expected 1 column, got a1..2"),
        (["stamp_s=a-1e"], "expected a CSV file"),
        (["stamp_s=a*2*3"], "'stamp_s': expected a number after"),
        (["true_y=a"], "'true_y': expected one of stamp_s"),
    ],
)
def test_a_naming_for_another_scene_is_refused(tmp_path, pairs, message):
    with pytest.raises(ScanError, match=message):
        read_csv(tmp_path / "a.csv", LINE, naming_from_pairs(pairs, ColumnNaming()))


@pytest.mark.parametrize("content", [None, "[1, 2]", "x: {a: b}", "x: [", "x: 3", "x: a\nx: b", "x: [[a]]"])
def test_an_invalid_naming_file_is_refused(tmp_path, content):
    path = tmp_path / "naming.yaml"
    if content is not None:
        path.write_text(content)
    with pytest.raises(ScanError, match=str(path)):
        load_naming(path)
