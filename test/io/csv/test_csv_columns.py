"""Columns are found by their names, given or standard, with units, sums and dates."""

import pickle
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.csv_files import HEADER, LINE, assert_four_rows, line_rows, write_csv

from tactile_localizer.errors import ScanError
from tactile_localizer.io.csv.columns import (
    ColumnNaming,
    MissingColumnError,
    load_naming,
    naming_from_dict,
    naming_from_pairs,
    naming_to_dict,
)
from tactile_localizer.io.csv.proposal import propose_scene
from tactile_localizer.io.csv.recording import read_csv
from tactile_localizer.scene import Axis, Phalanx, Scene


def test_columns_can_be_named(tmp_path):
    (tmp_path / "naming.yaml").write_text(
        "stamp_s: time * 0.001\nx: [pos_mm]\nindex: gauge1..8 * 0.5\nstrain_unit: counts\n"
    )
    naming = naming_from_pairs(["x=pos_mm*1e-3"], load_naming(tmp_path / "naming.yaml"))
    assert naming.strain_unit == "counts"
    assert naming_from_dict(naming_to_dict(naming)) == naming
    header = ["time", "pos_mm", *(f"gauge{gauge}" for gauge in range(1, 9))]
    path = write_csv(tmp_path / "a.csv", header, [[2500, 7, *range(8)]])
    sweep = read_csv(path, LINE, naming).sweeps[0]
    assert sweep.stamp_ns[0] == 2_500_000_000
    np.testing.assert_allclose(sweep.position, [[0.007]])
    np.testing.assert_allclose(sweep.strain, [np.arange(8) / 2])
    assert sweep.strain_unit == "counts"
    listed = naming_from_pairs(["index=" + ",".join(header[2:]), "stamp_s=time", "x=pos_mm"], ColumnNaming())
    np.testing.assert_allclose(read_csv(path, LINE, listed).sweeps[0].strain, [np.arange(8)])


def test_more_channels_than_the_scene_has_are_refused(tmp_path):
    header = ["stamp_s", "x", *(f"index_{n}" for n in range(1, 20))]
    path = write_csv(tmp_path / "a.csv", header, [[1, 0, *range(19)]])
    for naming in (ColumnNaming(), naming_from_pairs(["index=index_1..19"], ColumnNaming())):
        with pytest.raises(
            ScanError, match=r"expected 8 channels for phalanx index .* found 19 .* write channels: 19"
        ):
            read_csv(path, LINE, naming)


def test_names_with_commas_and_signs_can_be_given(tmp_path):
    forces = [f"Force {n}, N" for n in range(1, 9)]
    header = ["time, s", "x-2, mm * rel", *forces]
    rows = [[row[0], 1e3 * row[1], *row[2:]] for row in line_rows(4)]
    path = write_csv(tmp_path / "a.csv", header, rows)
    naming = {"stamp_s": ["time, s"], "x": ["x-2, mm * rel"], "index": forces}
    sweep = read_csv(path, Scene("mm", (Axis("x", 0, 4),), LINE.phalanges), naming_from_dict(naming)).sweeps[
        0
    ]
    np.testing.assert_allclose(sweep.position[:, 0], [0, 1, 2, 3])
    path = write_csv(tmp_path / "b.csv", [header[0], "x-2, mm", *forces], rows)
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
        ("sec", lambda n: (f"1970-01-01 00:00:01,{10 * n:03}", 0)),  # as logging writes it
        ("sec", lambda n: (f"1970/01/01 00:00:01.{10 * n:03}", 0)),
        ("sec", lambda n: (f"00:00:01.{10 * n:03}", 0)),
        ("sec", lambda n: (f"0:00:01,{10 * n:03}", 0)),
        ("sec-57600", lambda n: (f"16:00:01.{10 * n:03}", 0)),
        ("sec-1732550400", lambda n: (f"2024-11-25 16:00:01.{10 * n:03}Z", 0)),
    ],
)
def test_stamps_may_be_sums_shifted_dates_and_times_of_day(tmp_path, column, cells):
    rows = [[*cells(n), *row[1:]] for n, row in enumerate(line_rows(4))]
    path = write_csv(tmp_path / "a.csv", ["sec", "nanosec", *HEADER[1:]], rows)
    assert_four_rows(read_csv(path, LINE, naming_from_pairs([f"stamp_s={column}"], ColumnNaming())))


def test_rows_at_a_constant_rate_need_no_column_of_time(tmp_path):
    rows = [row[1:] for row in line_rows(4)]
    rows.insert(2, ["late", *rows[0][1:]])  # a row that cannot be read takes its time too
    path = write_csv(tmp_path / "a.csv", HEADER[1:], rows)
    for rate in ("row / 100 + 1", "row/100+1", "row * 0.01 + 1"):
        recording = read_csv(path, LINE, naming_from_pairs([f"stamp_s={rate}"], ColumnNaming()))
        assert "column x: expected a number, found 'late'" in recording.notes[0]
        (sweep,) = recording.sweeps
        assert (sweep.stamp_ns // 10**6).tolist() == [1000, 1010, 1030, 1040]
        np.testing.assert_allclose(sweep.position[:, 0], [0, 0.001, 0.002, 0.003])
    with pytest.raises(ScanError, match="--column 'stamp_s=row / RATE'"):
        read_csv(path, LINE)
    named = write_csv(tmp_path / "b.csv", ["row", *HEADER[1:]], line_rows(4))
    assert_four_rows(read_csv(named, LINE, naming_from_pairs(["stamp_s=row"], ColumnNaming())))


@pytest.mark.parametrize("separator", [",", ";", " ", "\t"])
@pytest.mark.parametrize("before", ["", "# of a logger, version 2\n", "Logger 2\n\n"])
def test_columns_without_names_are_given_by_number(tmp_path, separator, before):
    """As ``ros2 topic echo --csv`` writes them."""
    rows = [[1, 10_000_000 * n, "material", *row[1:]] for n, row in enumerate(line_rows(4))]
    text = "\n".join(separator.join(map(str, row)) for row in rows)
    if separator == ";":
        text = text.replace(".", ",")
    (tmp_path / "a.csv").write_text(before + text)
    naming = ["stamp_s=column1 + column2 * 1e-9", "x=column4", "index=column5..12"]
    assert_four_rows(read_csv(tmp_path / "a.csv", LINE, naming_from_pairs(naming, ColumnNaming())))
    with pytest.raises(
        MissingColumnError, match=r"no header \(line \d is numbers\): name columns by number"
    ) as error:
        propose_scene("own", [str(tmp_path / "a.csv")], ColumnNaming())
    assert "stamp_s: column1 + column2 * 1e-9, finger: column4..9" in str(error.value)
    assert "column3 (material)" in error.value.template
    assert "proposed" not in error.value.template
    with pytest.raises(MissingColumnError, match=r"stamp_s \(column13\)"):
        read_csv(tmp_path / "a.csv", LINE, naming_from_pairs(["stamp_s=column13"], ColumnNaming()))


def test_a_missing_column_of_a_phalanx_is_named_with_the_number_of_its_channels(tmp_path):
    scene = Scene("line", LINE.axes, (Phalanx("prox", (0,), 12),))
    columns = [f"t{n}_B{axis}" for n in range(4) for axis in "xyz"]
    rows = [[row[0], row[1], *range(11)] for row in line_rows(4)]
    path = write_csv(tmp_path / "a.csv", ["stamp_s", "x", *columns[:-1]], rows)
    naming = naming_from_dict({"prox": "t0..3_Bx, t0..3_By, t0..3_Bz"})
    with pytest.raises(MissingColumnError) as error:
        read_csv(path, scene, naming)
    expected = f"{path}: expected a column for prox (t3_Bz of 12 columns is missing), found stamp_s, x, t0_Bx"
    assert str(error.value).startswith(expected)
    assert str(error.value).endswith("; pass --column prox=NAME1..12")
    with pytest.raises(MissingColumnError, match=r"for prox \(prox_1, prox_2, .*, prox_12\), found"):
        read_csv(path, scene)
    again = pickle.loads(pickle.dumps(error.value))  # noqa: S301  as from a worker process
    assert (str(again), again.quantity, again.template) == (
        str(error.value),
        "prox",
        error.value.template,
    )


def test_columns_of_one_name_are_given_by_number(tmp_path):
    path = write_csv(
        tmp_path / "a.csv", [*HEADER, "x"], [[*row[:1], "", *row[2:], row[1]] for row in line_rows(4)]
    )
    with pytest.raises(
        ScanError, match=r"expected one column 'x', found 2; .* by its number, from 1: column2"
    ):
        read_csv(path, LINE)
    assert_four_rows(read_csv(path, LINE, naming_from_pairs(["x=column11"], ColumnNaming())))


def test_numbers_from_0_are_names(tmp_path):
    """As pandas writes an array; no phalanx is proposed of them."""
    path = write_csv(tmp_path / "a.csv", ["", *range(10)], [[n, *row] for n, row in enumerate(line_rows(4))])
    for naming in (["stamp_s=0", "x=1", "index=2..9"], ["stamp_s=column2", "x=column3", "index=column4..11"]):
        assert_four_rows(read_csv(path, LINE, naming_from_pairs(naming, ColumnNaming())))
    with pytest.raises(MissingColumnError) as error:
        propose_scene("own", [str(path)], ColumnNaming())
    assert "proposed" not in error.value.template


@pytest.mark.parametrize(
    "name", ["x_1", "y_1", "yaw_1", "stamp_s_1", "sweep_1", "felt_1", "true_x_1", "foo_1"]
)
def test_a_numbered_column_of_no_phalanx_is_ignored(tmp_path, name):
    rows = [[*row, 5.0] for row in line_rows(4)]
    assert_four_rows(read_csv(write_csv(tmp_path / "a.csv", [*HEADER, name], rows), LINE))


def test_a_phalanx_with_the_name_of_another_quantity_is_refused(tmp_path):
    scene = Scene("odd", LINE.axes, (Phalanx("x", (0,)),))
    with pytest.raises(ScanError, match="phalanx x: expected a name other than stamp_s"):
        read_csv(write_csv(tmp_path / "a.csv", HEADER, line_rows(4)), scene)


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("factor", ["1e100", "1e-400"])
def test_strain_that_a_factor_makes_too_large_is_missing(tmp_path, factor):
    rows = line_rows(4)
    rows[1][3] = rows[2][4] = "1e308"
    rows[3][5] = "inf"
    path = write_csv(tmp_path / "a.csv", HEADER, rows)
    (sweep,) = read_csv(path, LINE, naming_from_pairs([f"index=index_1..8*{factor}"], ColumnNaming())).sweeps
    assert np.isnan(sweep.strain[3, 3])
    assert np.isnan(sweep.strain[[1, 2], [1, 2]]).all() == (factor == "1e100")


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
        (["stamp_s=a*1e999999"], "'stamp_s': expected a number after"),
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
