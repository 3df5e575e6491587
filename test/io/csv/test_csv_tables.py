"""Tables of numbers are read as programs write them; what is none is refused in one line."""

import gzip
import os
import time
from contextlib import suppress

import numpy as np
import pytest
from support.csv_files import HEADER, LINE, as_text, assert_four_rows, line_rows, write_csv

from tactile_localizer.errors import ScanError
from tactile_localizer.io.csv.columns import (
    ColumnNaming,
    naming_from_pairs,
)
from tactile_localizer.io.csv.proposal import propose_scene
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.io.status import MISSING
from tactile_localizer.scene import Axis, Scene


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
        as_text(rows=[[row[0], *(f'"{cell}"' for cell in row[1:])] for row in line_rows(4)]),
        as_text().replace("\n", "\r"),
        as_text().replace("\n", "\r\n\r\n"),
        as_text(separator="|"),
        as_text(separator=" | "),
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


@pytest.mark.parametrize(
    "spelling", ["", " ", "nan", "NaN", "-nan", "NA", "N/A", "#N/A", "null", "None", "-", "inf", "1e200"]
)
def test_a_strain_that_is_missing_is_nan_in_any_spelling(tmp_path, spelling):
    rows = line_rows(4)
    rows[1][4] = rows[2][4] = rows[3][5] = spelling
    path = write_csv(tmp_path / "a.csv", HEADER, rows)
    recording = read_csv(path, LINE)
    (sweep,) = recording.sweeps
    np.testing.assert_array_equal(np.isnan(sweep.strain[:, 2:4]), [[0, 0], [1, 0], [1, 0], [0, 1]])
    assert sweep.status[:, 0].tolist() == [0, MISSING, MISSING, MISSING]
    assert recording.notes == (f"{path}: no number in index_3 (2 of 4 rows), index_4 (1 of 4 rows)",)


@pytest.mark.parametrize("cell", ["NA", "1e200", "late"])
def test_a_cell_changes_no_other_row(tmp_path, cell):
    """Many rows are read at once, and one by one where a cell is none or no number."""
    rng = np.random.default_rng(3)
    rows = [[f"{1.7e9 + n / 1000:.6f}", *rng.normal(size=9)] for n in range(20_000)]
    whole = read_csv(
        write_csv(tmp_path / "a.csv", HEADER, rows), Scene("wide", (Axis("x", -9, 9),), LINE.phalanges)
    )
    place = rng.integers(2, 10)
    rows[12_345][place] = cell
    partly = read_csv(
        write_csv(tmp_path / "b.csv", HEADER, rows), Scene("wide", (Axis("x", -9, 9),), LINE.phalanges)
    )
    (sweep,), (other,) = whole.sweeps, partly.sweeps
    kept = np.delete(np.arange(20_000), 12_345)
    same = kept if cell == "late" else np.arange(20_000)
    np.testing.assert_array_equal(other.stamp_ns, sweep.stamp_ns[same])
    at = np.searchsorted(same, kept)
    np.testing.assert_array_equal(other.strain[at], sweep.strain[kept])
    np.testing.assert_array_equal(other.position, sweep.position[same])


def test_a_line_of_text_between_rows_is_a_lost_row(tmp_path):
    """Only directly behind the header it has the units."""
    rows = line_rows(4)
    (tmp_path / "a.csv").write_text(
        as_text(rows=[["s", "m", *"V" * 8], *rows[:2], ["pause"] * 10, *rows[2:]])
    )
    recording = read_csv(tmp_path / "a.csv", LINE)
    assert recording.lost == 1
    (note,) = recording.notes
    assert note.endswith("(first: line 5, column stamp_s: expected a number, found 'pause')")


@pytest.mark.parametrize("clock", ["{sec}.{nanosec}", "2024-11-25 16:00:{sec:02}.{nanosec}"])
@pytest.mark.parametrize("digits", [3, 6, 9])
def test_a_fraction_without_its_zeros_is_read_as_meant(tmp_path, clock, digits):
    """``f"{sec}.{nanosec}"`` writes 1 s and 20 ms as 1.20000000."""
    rows = [[0, *row[1:]] for row in line_rows(400)]
    for n, row in enumerate(rows):
        row[0] = clock.format(sec=1 + n // 50, nanosec=n % 50 * 20 * 10 ** (digits - 3))
    recording = read_csv(write_csv(tmp_path / "a.csv", HEADER, rows), LINE)
    (sweep,) = recording.sweeps
    assert (np.diff(sweep.stamp_ns) == 20_000_000).all()
    (note,) = recording.notes
    name = {3: "MILLISEC", 6: "MICROSEC", 9: "NANOSEC"}[digits]
    assert f"a.csv: stamps look like SEC.{name} without leading zeros (line 6: " in note


def test_decimals_of_any_length_that_go_back_are_another_run(tmp_path):
    rows = [[f"{n % 70 / 100:g}", *row[1:]] for n, row in enumerate(line_rows(210))]
    recording = read_csv(write_csv(tmp_path / "a.csv", HEADER, rows), LINE)
    assert [len(sweep) for sweep in recording.sweeps] == [70, 70, 70]


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
        (HEAD, "expected rows of numbers, found none$"),
        (HEAD + "a" + ROW, "found none in 1 rows .line 2, column stamp_s: expected a number, found 'a'"),
        (HEAD + "25.11.2024 16:00" + ROW, r"found '25.11.2024 16:00' \(a date\? write it like 2024-11-25 16"),
        (HEAD + "1,0" + ",5" * 16, "line 2: expected 10 cells as in the header, found 18 .decimal commas"),
        (
            HEAD + "1.7e12" + ROW,
            r"a stamp in s, found 1.7e\+12 .another unit\? --column stamp_s=stamp_s\*0.001",
        ),
        (HEAD + "17e17" + ROW, r"found 1.7e\+18 \(another unit\? .* \*1e-9 for ns"),
        ("x," + HEAD, "expected one column 'x', found 2"),
        (SWEEPS + "".join(f"run_{n % 2},{n}{ROW}" for n in range(3)), "together, found sweeps 1, 2, 1"),
        (SWEEPS + "nan,0" + ROW, "column sweep: expected a number, found 'nan'"),
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
    begun_s = time.process_time()
    with pytest.raises(ScanError, match=r"expected at most \d+ rows, found \d+, or .*; split it by sweeps"):
        read_csv(tmp_path / "many.csv.gz", LINE)
    assert time.process_time() - begun_s < 5
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
        path = write_csv(tmp_path / "a.csv", header, rows, delimiter="\t")
        assert len(read_csv(path, LINE, naming)) == 4 - (place == "row")
    with suppress(ScanError):
        propose_scene("own", [str(write_csv(tmp_path / "b.csv", header[:1] + header[-1:], rows))], naming)
    assert time.process_time() - begun_s < 2


@pytest.mark.parametrize(
    "names", [("run_a", "run_b"), ("20241125_1", "20241125_2"), ("up", "2"), ("é", "b c")]
)
def test_sweeps_may_have_names(tmp_path, names):
    path = tmp_path / "a.csv"
    path.write_text(SWEEPS + "".join(f"{names[n // 2]},{n}{ROW}" for n in range(4)))
    recording = read_csv(path, LINE)
    assert [sweep.stamp_ns.tolist() for sweep in recording.sweeps] == [[0, 10**9], [2 * 10**9, 3 * 10**9]]
    assert f"{path}: sweeps in the order of the file: {', '.join(names)}" in recording.notes


def test_a_name_among_numbers_of_sweeps_is_no_sweep(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(SWEEPS + "".join(f"{name},{n}{ROW}" for n, name in enumerate(("7", "7", "x"))))
    recording = read_csv(path, LINE)
    assert [len(sweep) for sweep in recording.sweeps] == [2]
    assert "column sweep: expected a number, found 'x'" in " ".join(recording.notes)


@pytest.mark.parametrize("other", [[*HEADER[:2], *HEADER[:1:-1]], [*HEADER[:2], *HEADER[3:]]])
def test_another_header_behind_the_rows_is_refused(tmp_path, other):
    """As of two files behind each other, whose columns are others, or in another order."""
    rows = [*line_rows(4), other, *(row[: len(other)] for row in line_rows(4))]
    path = write_csv(tmp_path / "a.csv", HEADER, rows)
    with pytest.raises(ScanError, match="line 6: expected numbers, found another header"):
        read_csv(path, LINE)
