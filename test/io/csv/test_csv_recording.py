"""CSV files are read by the names of their columns; invalid rows are skipped, counted and reported."""

import csv
import gzip
import os

import numpy as np
import pytest

from tactile_localizer.core.geometry.synchronization import interpolate_poses
from tactile_localizer.errors import ScanError
from tactile_localizer.io.csv.columns import (
    ColumnNaming,
    load_naming,
    naming_from_dict,
    naming_from_pairs,
    naming_to_dict,
)
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.status import MISSING
from tactile_localizer.scene import Axis, Phalanx, Scene

SCENE = Scene(
    "bump", (Axis("x", 0, 1), Axis("y", 0, 1)), (Phalanx("index", (0, 0)), Phalanx("middle", (0, 0)))
)
LINE = Scene("line", (Axis("x", 0, 1),), (Phalanx("index", (0,)),))
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
    assert recording.notes[0].startswith(
        f"skipped 6 of 12 rows of {path} that are not numbers (first: line 6: late"
    )
    assert recording.notes[1] == f"skipped 1 of 6 rows of {path} whose stamps do not increase"


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
        (b"\xff\xfd\x00\x80" * 50, "expected a CSV file in UTF-8"),
        ("stamp_s".encode("utf-16"), "expected a CSV file in UTF-8"),
        (b"\x1f\x8b\x08", "expected a CSV file, Compressed file ended"),
        (HEAD, "expected rows of numbers, found none in 0 rows"),
        (HEAD + "a" + ROW, "found none in 1 rows .line 2: a, 0, 1"),
        (HEAD + "1,0" + ",5" * 16, "line 2: expected 10 cells as in the header, found 18 .decimal commas"),
        (
            HEAD + "1.7e12" + ROW,
            r"in s, found 1.7e\+12 .another unit\? --column stamp_s=stamp_s\*0.001",
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
    with pytest.raises(ScanError, match="line 2: expected at most 20000000 lines of 16777216 characters"):
        read_csv(tmp_path / "bomb.csv.gz", LINE)
    (tmp_path / "wide.csv").write_text(",".join(f"c{n}c" for n in range(10**6)) + "\n")
    with pytest.raises(ScanError, match="and 999980 more") as refusal:
        read_csv(tmp_path / "wide.csv", LINE)
    assert len(str(refusal.value)) < 1000


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        (["x"], "expected QUANTITY=COLUMN"),
        (["x=a*b"], "'x': expected a number after"),
        (["x=a*nan"], "'x': expected a number after"),
        (["x=a*0"], "'x': expected a number after .* other than 0, got '0'"),
        (["thumb=g1..8"], "'thumb': expected one of stamp_s, pose_stamp_s, sweep, x, index"),
        (["index=g1..999999999"], "'index': expected 1 to 4096 columns"),
        (["x=a,b"], "'x': expected 1 column, got a,b"),
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
