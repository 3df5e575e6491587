"""CSV files of all dialects are read; invalid rows are skipped, counted and reported."""

import csv
import gzip
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.notes import counts

from tactile_localizer.errors import ScanError
from tactile_localizer.io.csv.columns import (
    ColumnNaming,
    load_naming,
    naming_from_dict,
    naming_from_pairs,
    naming_to_dict,
)
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.io.status import MISSING
from tactile_localizer.scene import Axis, Phalanx, Scene

ROOT = Path(__file__).parents[3]

SCENE = Scene(
    "bump", (Axis("x", 0, 1), Axis("y", 0, 1)), (Phalanx("index", (0, 0)), Phalanx("middle", (0, 0)))
)
LINE = Scene("line", (Axis("x", 0, 1),), (Phalanx("index", (0,)),))
GAUGES = [f"index_{gauge}" for gauge in range(1, 9)]


def write(path: Path, header: list[str], rows: list[list[object]], **options: str) -> Path:
    with path.open("w", newline="") as file:
        csv.writer(file, **options).writerows([header, *rows])
    return path


def line_rows(n: int) -> list[list[object]]:
    return [
        [f"{1.0 + 0.01 * row:.2f}", 0.001 * row, *(row + gauge / 10 for gauge in range(8))]
        for row in range(n)
    ]


def test_standard_columns_are_read_by_name(tmp_path):
    names = ["middle_1", "x", "stamp_s", "sweep", "y", "note"]
    names += [f"middle_{gauge}" for gauge in range(2, 9)] + GAUGES
    rng = np.random.default_rng(1)
    table = {name: rng.uniform(0, 1, 6) for name in names}
    table["stamp_s"] = np.array([1, 2, 3, 1, 2, 3.0])
    table["sweep"] = np.array([4, 4, 4, 0, 0, 0])
    rows = [
        [repr(float(table[name][row])) if name != "note" else "felt" for name in names] for row in range(6)
    ]
    recording = read_csv(write(tmp_path / "a.csv", names, rows), SCENE)
    assert recording.axes == ("x", "y")
    assert recording.phalanges == ("index", "middle")
    assert recording.notes == ()
    assert [sweep.number for sweep in recording.sweeps] == [4, 0]
    first = recording.sweeps[0]
    np.testing.assert_array_equal(first.stamp_ns, np.array([1, 2, 3]) * 1_000_000_000)
    np.testing.assert_array_equal(first.position, np.column_stack([table["x"][:3], table["y"][:3]]))
    expected = [table[f"{phalanx}_{gauge}"][:3] for phalanx in ("index", "middle") for gauge in range(1, 9)]
    np.testing.assert_array_equal(first.strain, np.column_stack(expected))
    assert first.truth is None


def test_stamps_since_1970_keep_their_nanoseconds(tmp_path):
    rows = [["1700000000.123456789", 0, *[0] * 8]]
    sweep = read_csv(write(tmp_path / "a.csv", ["stamp_s", "x", *GAUGES], rows), LINE).sweeps[0]
    assert sweep.stamp_ns[0] == 1_700_000_000_123_456_789


def test_each_file_is_a_sweep(tmp_path):
    header = ["stamp_s", "x", *GAUGES]
    files = [write(tmp_path / f"{name}.csv", header, line_rows(3)) for name in "abc"]
    numbered = write(tmp_path / "d.csv", [*header, "sweep"], [[*row, 2] for row in line_rows(3)])
    recording = read_csv([*files, numbered], LINE)
    assert [sweep.number for sweep in recording.sweeps] == [1, 2, 3, 4]


@pytest.mark.parametrize(
    ("speed", "expected"), [(0.5, [0, 0.005, 0.01, 0.015]), (-0.5, [0.015, 0.01, 0.005, 0])]
)
def test_constant_speed_gives_positions(tmp_path, speed, expected):
    header = ["stamp_s", *GAUGES, "sweep"]
    rows = [[row[0], *row[2:], sweep] for sweep in (1, 2) for row in line_rows(4)]
    recording = read_csv(write(tmp_path / "a.csv", header, rows), LINE, ColumnNaming(speed={"x": speed}))
    for sweep in recording.sweeps:
        np.testing.assert_allclose(sweep.position[:, 0], expected, atol=1e-12)


def test_columns_can_be_named(tmp_path):
    (tmp_path / "naming.yaml").write_text(
        "stamp_s: time * 0.001\nx: [pos_mm]\nindex: gauge1..8 * 0.5\nstrain_unit: counts\n"
    )
    naming = naming_from_pairs(["x=pos_mm*1e-3"], load_naming(tmp_path / "naming.yaml"))
    assert naming.strain_unit == "counts"
    header = ["time", "pos_mm", *(f"gauge{gauge}" for gauge in range(1, 9))]
    path = write(tmp_path / "a.csv", header, [[2500, 7, *range(8)]])
    sweep = read_csv(path, LINE, naming).sweeps[0]
    assert sweep.stamp_ns[0] == 2_500_000_000
    np.testing.assert_allclose(sweep.position, [[0.007]])
    np.testing.assert_allclose(sweep.strain, [np.arange(8) / 2])
    listed = naming_from_pairs(["index=" + ",".join(header[2:]), "stamp_s=time", "x=pos_mm"], ColumnNaming())
    np.testing.assert_allclose(read_csv(path, LINE, listed).sweeps[0].strain, [np.arange(8)])


def test_invalid_rows_are_counted(tmp_path):
    rows = line_rows(10)
    rows[2][0] = "late"
    rows[3][4] = "high"
    rows[4] = rows[4][:3]
    rows[5][1] = "nan"
    rows[6][0] = rows[1][0]
    rows[7][0] = "1e300"
    recording = read_csv(write(tmp_path / "a.csv", ["stamp_s", "x", *GAUGES], rows), LINE)
    assert len(recording) == 4
    assert counts(recording.notes) == [(6, 10)]
    (note,) = recording.notes
    reasons = re.findall(r"(\d+) (?:with a )?(not|position|stamp)[^,]*?\(first: line (\d+)", note)
    assert reasons == [("3", "not", "4"), ("1", "position", "7"), ("1", "stamp", "9"), ("1", "stamp", "8")]
    assert "stamp_s 'late'" in note


def test_nan_marks_only_its_phalanx_missing(tmp_path):
    names = ["stamp_s", "x", "y", *GAUGES, *(f"middle_{gauge}" for gauge in range(1, 9))]
    rows = [[1, 0, 0, *range(16)], [2, 0, 0, *range(16)]]
    rows[1][3 + 9] = "nan"
    rows[0][3] = "inf"
    sweep = read_csv(write(tmp_path / "a.csv", names, rows), SCENE).sweeps[0]
    np.testing.assert_array_equal(sweep.status, [[MISSING, 0], [0, MISSING]])
    np.testing.assert_array_equal(np.isnan(sweep.strain).sum(axis=1), [1, 1])


def test_spaces_quotes_and_byte_order_marks_are_ignored(tmp_path):
    lines = ["\ufeffstamp_s, x, " + ", ".join(GAUGES), "", '"1.5", 0.25,' + ",".join("12345678"), ""]
    (tmp_path / "a.csv").write_text("\r\n".join(lines), encoding="utf-8")
    recording = read_csv(tmp_path / "a.csv", LINE)
    assert len(recording) == 1
    assert recording.notes == ()


@pytest.mark.parametrize(("delimiter", "comma"), [(";", "."), (";", ","), ("\t", ","), ("\t", ".")])
def test_semicolons_tabs_and_decimal_commas_are_read(tmp_path, delimiter, comma):
    rows = [[str(cell).replace(".", comma) for cell in row] for row in line_rows(4)]
    path = write(tmp_path / "a.csv", ["stamp_s", "x", *GAUGES], rows, delimiter=delimiter)
    recording = read_csv(path, LINE)
    assert recording.notes == ()
    np.testing.assert_allclose(recording.sweeps[0].position[:, 0], [0, 0.001, 0.002, 0.003])
    np.testing.assert_array_equal(recording.sweeps[0].stamp_ns, 10**9 + 10**7 * np.arange(4))


def test_comments_are_skipped(tmp_path):
    path = write(tmp_path / "a.csv", ["stamp_s", "x", *GAUGES], line_rows(3))
    lines = path.read_text().splitlines()
    lines = [
        "# recorded on a Monday, by hand",
        "",
        *lines[:2],
        "# a rest, the hand was opened",
        *lines[2:],
        "x",
    ]
    path.write_text("\n".join(lines))
    recording = read_csv(path, LINE)
    assert len(recording) == 3
    assert recording.notes == (f"{path}: skipped 1 of 4 rows: 1 not numbers (first: line 8, stamp_s 'x')",)


@pytest.mark.parametrize(
    ("wrong", "first"), [({50: 900.0}, 52), ({50: -900.0}, 52), ({50: 900.0, 51: 900.5, 70: 0.0}, 52)]
)
def test_stamp_outliers_cost_only_their_rows(tmp_path, wrong, first):
    rows = line_rows(100)
    for row, jump in wrong.items():
        rows[row][0] = f"{float(rows[row][0]) + jump if jump else 0}"
    path = write(tmp_path / "a.csv", ["stamp_s", "x", *GAUGES], rows)
    recording = read_csv(path, LINE)
    assert len(recording) == 100 - len(wrong)
    assert (np.diff(recording.sweeps[0].stamp_ns) > 0).all()
    assert counts(recording.notes) == [(len(wrong), 100)]
    assert f"out of order (first: line {first})" in recording.notes[0]


def test_yaw_in_degrees_is_reported(tmp_path):
    scene = Scene("turn", (Axis("yaw", -np.pi, np.pi),), (Phalanx("index", (0,)),))
    rows = [[row[0], 30 * n, *row[2:]] for n, row in enumerate(line_rows(5))]
    path = write(tmp_path / "a.csv", ["stamp_s", "yaw", *GAUGES], rows)
    assert "in degrees: --column yaw=yaw*0.0174533" in read_csv(path, scene).notes[0]


@pytest.mark.parametrize("label", ["s1", "1e30", "nan", "inf", ""])
def test_named_sweeps_are_reported(tmp_path, label):
    path = write(tmp_path / "a.csv", ["sweep", "stamp_s", "x", *GAUGES], [[label, *r] for r in line_rows(5)])
    with pytest.raises(ScanError, match=r"found none in 5 rows: 5 not numbers \(first: line 2"):
        read_csv(path, LINE)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "expected a CSV file, No such file"),
        (b"", "expected a column 'stamp_s' .*, found no header"),
        (
            b"stamp_s,x\n1,2\n",
            r"expected a column 'index_1' \(or --column index=NAME1..8\), found stamp_s, x",
        ),
        (b"\xff\xfd\x00\x80" * 50, "expected a CSV file in UTF-8"),
        (("stamp_s,x," + ",".join(GAUGES) + "\n").encode(), "expected rows of numbers, found none in 0 rows"),
        (
            ("stamp_s,x," + ",".join(GAUGES) + "\na" + ",b" * 9).encode(),
            "found none in 1 rows: 1 not numbers .*stamp_s 'a'",
        ),
        (("stamp_s,x,x," + ",".join(GAUGES) + "\n").encode(), "expected one column 'x'"),
    ],
)
def test_unusable_files_are_refused(tmp_path, content, message):
    path = tmp_path / "a.csv"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ScanError, match=message) as refusal:
        read_csv(path, LINE)
    assert str(refusal.value).startswith(str(path))
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("text", "scale"),
    [
        ("x: a * 3e-3", 3e-3),
        ("x: {columns: [a], scale: 3e-3}", 3e-3),
        ("x: a * -.5", -0.5),
        ("x: a * pi/180", np.pi / 180),
    ],
)
def test_scales_are_numbers_as_everywhere(tmp_path, text, scale):
    (tmp_path / "naming.yaml").write_text(text)
    naming = load_naming(tmp_path / "naming.yaml")
    assert float(naming.of("x").scale) == pytest.approx(scale, rel=1e-12)
    assert naming_from_dict(naming_to_dict(naming)) == naming


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        (["x"], "expected QUANTITY=COLUMN"),
        (["=a"], "expected QUANTITY=COLUMN"),
        (["x=a*b"], "expected a number after"),
        (["x=a*nan"], "'x': expected a number after"),
        (["x=a*1_000"], "'x': expected a number after"),
        (["x=a*1e999"], "'x': expected a number after"),
        (["x=a*0"], "'x': expected a number after .* other than 0, got '0'"),
        (["thumb=g1..8"], "'thumb': expected one of stamp_s, sweep, x, index"),
        (["index=g1..7"], "'index': expected 8 columns, got 7"),
        (["index=g1..99999999999"], "'index': expected at most 1024 columns, got 'g1..99999999999'"),
        ([f"index=g1..{'9' * 5000}"], "'index': expected at most 1024 columns"),
        (["x=a,b"], "'x': expected 1 columns, got 2"),
    ],
)
def test_a_naming_for_another_scene_is_refused(tmp_path, pairs, message):
    with pytest.raises(ScanError, match=message):
        read_csv(tmp_path / "a.csv", LINE, naming_from_pairs(pairs, ColumnNaming()))


@pytest.mark.parametrize(
    "content",
    [
        *(None, "[1, 2]", "x: {a: b}", "x: [", "x: 3", "x: a\nx: b", "1: a"),
        *("x: {columns: [a], scale: .nan}", "x: {columns: [a], scale: true}", "x: {columns: [a], scale: 0}"),
    ],
)
def test_an_invalid_naming_file_is_refused(tmp_path, content):
    path = tmp_path / "naming.yaml"
    if content is not None:
        path.write_text(content)
    with pytest.raises(ScanError, match=str(path)):
        load_naming(path)


def test_speed_of_an_unknown_axis_is_refused(tmp_path):
    with pytest.raises(ScanError, match="speed of axis 'y': expected one of x"):
        read_csv(tmp_path / "a.csv", LINE, ColumnNaming(speed={"y": 0.1}))


def test_fabric_recordings_are_read(data_dir):
    for material in ("Linen", "Canvas"):
        scene = load_scene(ROOT / "config" / "scenes" / f"{material.lower()}.yaml")
        naming = load_naming(ROOT / "config" / "import" / "fabric_slide.yaml")
        files = sorted((data_dir / "fabric_slide").glob(f"{material}_F250_V10mmps_*.csv"))
        recording = read_csv(files, scene, replace(naming, speed={"x": 0.01}))
        assert recording.notes == ()
        for sweep in recording.sweeps:
            assert len(sweep) > 2000
            assert 0.58 < sweep.position[-1, 0] < 0.60
            assert np.isfinite(sweep.strain).all()


def test_rows_wider_than_the_header_are_refused(tmp_path):
    rows = [[str(cell).replace(".", ",") for cell in row] for row in line_rows(4)]
    path = tmp_path / "a.csv"
    lines = [",".join(row) for row in [["stamp_s", "x", *GAUGES], *rows]]
    path.write_text("\n".join(lines))
    with pytest.raises(ScanError, match=r"line 2: expected 10 cells as in the header, found 20 .*semicolons"):
        read_csv(path, LINE)


def test_trailing_empty_cells_are_ignored(tmp_path):
    path = write(tmp_path / "a.csv", ["stamp_s", "x", *GAUGES], [[*row, "", " "] for row in line_rows(4)])
    assert len(read_csv(path, LINE)) == 4


def test_gzip_is_read(tmp_path):
    path = write(tmp_path / "a.csv", ["stamp_s", "x", *GAUGES], line_rows(4))
    packed = tmp_path / "a.csv.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    np.testing.assert_array_equal(
        read_csv(packed, LINE).sweeps[0].strain, read_csv(path, LINE).sweeps[0].strain
    )
    packed.write_bytes(packed.read_bytes()[:-20])
    with pytest.raises(ScanError, match="expected a CSV file in gzip"):
        read_csv(packed, LINE)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le"])
def test_utf_16_is_refused_by_name(tmp_path, encoding):
    path = write(tmp_path / "a.csv", ["stamp_s", "x", *GAUGES], line_rows(4))
    mark = b"" if encoding == "utf-16" else b"\xff\xfe"
    path.write_bytes(mark + path.read_text().encode(encoding))
    with pytest.raises(ScanError, match="expected text in UTF-8, found UTF-16; save it as UTF-8"):
        read_csv(path, LINE)


def test_messages_about_huge_headers_are_short(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(",".join(f'"c\n{n}"' for n in range(10**6)) + "\n")
    with pytest.raises(ScanError) as refusal:
        read_csv(path, LINE)
    assert "and 999980 more" in str(refusal.value)
    assert len(str(refusal.value)) < 1000
    assert "\n" not in str(refusal.value)


def test_namings_survive_writing_and_reading():
    content = {
        "stamp_s": "time * 0.001",
        "x": "position",
        "index": ["a", "c"],
        "middle": {"columns": ["a", "b*c", "d"], "scale": 0.5},
        "strain_unit": "counts",
        "speed": {"y": 0.01},
    }
    naming = naming_from_dict(content)
    assert naming_to_dict(naming) == content
    assert naming_from_dict(naming_to_dict(naming)) == naming
