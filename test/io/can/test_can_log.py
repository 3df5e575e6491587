"""Recorded CAN logs are read in the formats of python-can, with their stamps."""

from copy import copy
from functools import cache
from pathlib import Path

import can
import numpy as np
import pytest
from support.load_cells import PERIOD_NS, START_NS, cycle, number_of, protocol, strain_of

from tactile_localizer.errors import ScanError
from tactile_localizer.io.can.log import read_log
from tactile_localizer.io.can.protocol import protocol_of

HAND = protocol()
SUFFIXES = ("log", "asc", "blf", "trc")
RELATIVE_ASC = (
    b"date Mon Nov 23 10:11:12.345 am 2026\nbase hex  timestamps relative\ninternal events logged\n"
    b"   0.010000 1  102             Rx   d 8 00 00 00 00 00 00 00 00\n"
)


def recorded(path: Path, frames: list[can.Message], channel: str | int = 0) -> Path:
    with can.Logger(path) as log:
        for frame in frames:
            frame.channel = channel
            log.on_message_received(frame)
    return path


@cache
def encoded(number: int) -> tuple[can.Message, ...]:
    """Frames of a cycle, made once because encoding is slow."""
    return tuple(cycle(HAND, number))


def frames_of(numbers: range) -> list[can.Message]:
    return [copy(frame) for number in numbers for frame in encoded(number)]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_each_cycle_of_a_log_is_a_strain_vector_with_its_stamp(tmp_path: Path, suffix: str) -> None:
    path = recorded(tmp_path / f"sweep.{suffix}", frames_of(range(1100)))
    shown: list[float] = []
    stamp_ns, strain, lost, notes = read_log(
        path, HAND, progress=lambda text, fraction: shown.append(fraction)
    )
    assert len(strain) >= 1098, "all but the first ones, before the period is known"
    sent = range(1100 - len(strain), 1100)
    expected = [np.concatenate([strain_of(p, number) for p in (0, 1)]) for number in sent]
    np.testing.assert_allclose(strain, expected, atol=1e-9)
    expected_ns = START_NS + np.array(sent) * PERIOD_NS
    np.testing.assert_allclose(stamp_ns - expected_ns, 0, atol=1_000_000)
    assert not notes
    assert not lost
    assert shown == sorted(shown)
    assert 0 < shown[0] <= shown[-1] <= 1


def test_what_is_no_strain_is_missing_and_losses_are_noted(tmp_path: Path) -> None:
    frames = frames_of(range(100))
    del frames[4 * 50]
    error = can.Message(timestamp=START_NS * 1e-9, is_error_frame=True)
    faulty = HAND.encode(1, np.zeros(8), 100, status=2, stamp_s=1e-9 * (START_NS + 100 * PERIOD_NS))
    path = recorded(tmp_path / "sweep.log", [error, *frames, *cycle(HAND, 100)[:2], *faulty], "can0")
    _, strain, _, notes = read_log(path, HAND)
    assert np.isnan(strain).sum() == 16
    assert np.isnan(strain[-1, 8:]).all()
    assert notes == [f"{path}: 1 frames of index lost"]


def test_saturated_strain_of_a_log_is_missing(tmp_path: Path) -> None:
    high = HAND.encode(1, np.full(8, 99.0), 100, stamp_s=1e-9 * (START_NS + 100 * PERIOD_NS))
    frames = [*frames_of(range(100)), *cycle(HAND, 100)[:2], *high]
    strain = read_log(recorded(tmp_path / "sweep.log", frames, "can0"), HAND).strain
    assert np.isnan(strain[-1, 8:]).all()
    assert np.isfinite(strain[-1, :8]).all()


CAN_XL = "(1700000005.000000) can0 00000123#80:00:00000000#1122334455\n"
NO_HEX = "(1700000005.000000) can0 102#0z\n"


@pytest.mark.parametrize("line", [CAN_XL, NO_HEX, "(1700000005.0\n", "\xff\x00 no text\n"])
def test_a_foreign_line_is_left_out_and_counted(tmp_path: Path, line: str) -> None:
    path = recorded(tmp_path / "sweep.log", frames_of(range(100)), "can0")
    whole, lines = read_log(path, HAND).strain, path.read_text().splitlines(keepends=True)
    path.write_bytes("".join([*lines[:200], line, *lines[200:]]).encode("latin-1"))
    read = read_log(path, HAND)
    np.testing.assert_array_equal(read.strain, whole)
    assert f"{path}: expected a log that python-can reads" in read.notes[0]
    assert "left out 1 of 401 lines (first: line 201" in read.notes[0]


@pytest.mark.parametrize(
    ("suffix", "number", "other"),
    [("asc", " 102 ", " 1G2 "), ("trc", "0102", "01G2"), ("csv", "0x102", "0xG02")],
)
def test_a_foreign_line_of_any_text_is_left_out(tmp_path: Path, suffix: str, number: str, other: str) -> None:
    path = recorded(tmp_path / f"sweep.{suffix}", frames_of(range(100)))
    whole, lines = read_log(path, HAND).strain, path.read_text().splitlines(keepends=True)
    at = next(row for row, line in enumerate(lines) if row > 200 and number in line)
    path.write_text("".join([*lines[:at], lines[at].replace(number, other), *lines[at:]]))
    read = read_log(path, HAND)
    np.testing.assert_array_equal(read.strain, whole)
    assert "left out 1 of" in read.notes[0]


def test_a_raw_length_code_is_read(tmp_path: Path) -> None:
    path = recorded(tmp_path / "sweep.log", frames_of(range(100)), "can0")
    whole = read_log(path, HAND)
    path.write_text("".join(line.replace(" R\n", "_9 R\n") for line in path.open()))
    np.testing.assert_array_equal(read_log(path, HAND).strain, whole.strain)
    assert not whole.notes


def test_a_line_without_its_end_is_left_out(tmp_path: Path) -> None:
    path = recorded(tmp_path / "sweep.log", frames_of(range(100)), "can0")
    path.write_text(path.read_text().removesuffix(" R\n")[:-1])
    _, strain, _, notes = read_log(path, HAND)
    assert np.isnan(strain[-1, 8:]).all()
    assert "left out 1 of 400 lines (first: line 400" in notes[0]


@pytest.mark.parametrize(
    ("suffix", "cycles"), [("blf", 5000), ("log.gz", 1000)]
)  # a BLF has parts of 128 KiB
def test_a_cut_log_says_up_to_where_it_was_read(tmp_path: Path, suffix: str, cycles: int) -> None:
    path = recorded(tmp_path / f"sweep.{suffix}", frames_of(range(cycles)))
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 3 // 4])
    _, strain, lost, notes = read_log(path, HAND)
    assert len(strain) < 0.98 * cycles
    assert "could be read up to" in notes[0]
    assert suffix != "blf" or 0.2 < lost / (lost + len(strain)) < 0.3


def test_a_cut_database_is_refused(tmp_path: Path) -> None:
    path = recorded(tmp_path / "sweep.db", frames_of(range(1000)))
    path.write_bytes(path.read_bytes()[:-8192])
    with pytest.raises(ScanError, match="expected a log that python-can reads"):
        read_log(path, HAND)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_channel_is_the_one_that_the_file_names(tmp_path: Path, suffix: str) -> None:
    hands = [frames_of(range(number, number + 100)) for number in (0, 300)]
    path = tmp_path / f"two.{suffix}"
    with can.Logger(path) as log:
        for pair in zip(*hands, strict=True):
            for channel, frame in enumerate(pair):  # python-can writes them from 1 on
                frame.channel = f"can{channel + 1}" if suffix == "log" else channel
                log.on_message_received(frame)
    names = ("can1", "can2") if suffix == "log" else ("1", "2")
    first = [number_of(0, read_log(path, HAND, name).strain[-1, :8]) for name in names]
    assert first == [99, 399]
    with pytest.raises(ScanError, match=f"expected one channel, found {', '.join(names)}"):
        read_log(path, HAND)
    with pytest.raises(ScanError, match=f"expected the channel 7, found {', '.join(names)}"):
        read_log(path, HAND, "7")


@pytest.mark.parametrize("suffix", ["csv", "db"])
@pytest.mark.parametrize(("lead", "later_s"), [(100, 0.0), (3, 0.0), (1, 0.0), (1, 0.002), (-1, 0.004)])
def test_two_hands_in_a_format_without_channels_are_refused(
    tmp_path: Path, suffix: str, lead: int, later_s: float
) -> None:
    frames = []
    for number in range(1, 301):
        stamp_s = 1e-9 * (START_NS + number * PERIOD_NS) + later_s
        other = [
            frame
            for p in (0, 1)
            for frame in HAND.encode(p, -strain_of(p, number), number + lead, 0, stamp_s)
        ]
        frames += sorted([*cycle(HAND, number), *other], key=lambda frame: frame.timestamp)
    path = recorded(tmp_path / f"two.{suffix}", frames)
    with pytest.raises(ScanError, match=r"two load cells with its identifiers.*keeps no channels"):
        read_log(path, HAND)
    with pytest.raises(ScanError, match="expected the channel 1, found none, which the format does not keep"):
        read_log(path, HAND, "1")


@pytest.mark.parametrize("later_s", [0.0, 0.002, 0.004])
def test_two_hands_without_counters_alternate(tmp_path: Path, later_s: float) -> None:
    hand = protocol_of(("index", "middle"), {"dbc": "loadcells.dbc", "counter_signal": ""})
    frames = []
    for number in range(300):
        one, other = cycle(hand, number), cycle(hand, 2 * number // 3 + 100)
        for frame, at in zip(other, one, strict=True):
            frame.timestamp = at.timestamp + later_s
        frames += sorted([*one, *other], key=lambda frame: frame.timestamp)
    with pytest.raises(ScanError, match="alternates from sample to sample: two load cells"):
        read_log(recorded(tmp_path / "two.csv", frames), hand)


def test_counters_that_jump_are_reported_as_by_the_driver(tmp_path: Path) -> None:
    frames = frames_of(range(200))
    for frame in frames_of(range(300, 400)):
        frame.timestamp -= 1e-9 * 100 * PERIOD_NS
        frames[4 * 200 :] = [*frames[4 * 200 :], frame]
    path = recorded(tmp_path / "sweep.log", frames, "can0")
    assert any("the counter restarted" in note for note in read_log(path, HAND).notes)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("none.log", None, "No such file"),
        ("sweep.txt", b"x", "sweep.txt: expected a log that python-can reads"),
        ("sweep.log", b"not a log\n", "sweep.log: expected a log that python-can reads"),
        ("sweep.blf", b"not a log\n", "sweep.blf: expected a log that python-can reads"),
        ("sweep.log", b"(1.0) can0 700#00\n", "none of 1 frames has an identifier of the DBC"),
        ("sweep.log", b"(1.0) can0 102#00\n", "0x102 index_a: 1 bytes instead of 8"),
        ("sweep.log", b"(1.0) can0 102#00\n(1.1) can1 102#00\n", "expected one channel, found can0, can1"),
        ("sweep.asc", RELATIVE_ASC, "expected absolute time stamps, found relative ones"),
    ],
)
def test_a_log_without_strain_is_refused_with_the_reason(
    tmp_path: Path, name: str, content: bytes | None, reason: str
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(ScanError, match=reason):
        read_log(tmp_path / name, HAND)


def test_one_of_several_channels_is_read(tmp_path: Path) -> None:
    path = recorded(tmp_path / "sweep.log", frames_of(range(100)), "can1")
    path.write_text("".join(line + line.replace("can1", "can0") for line in path.open()))
    assert len(read_log(path, HAND, "can1")[1]) >= 98
    with pytest.raises(ScanError, match="expected the channel can7, found can0, can1"):
        read_log(path, HAND, "can7")


def test_times_between_the_frames_of_a_log_are_named(tmp_path: Path) -> None:
    path = recorded(tmp_path / "sweep.log", frames_of(range(100)), "can0")
    lines = [line.partition(") ") for line in path.read_text().splitlines(keepends=True)]
    times = [float(line[0][1:]) for line in lines]
    steps = np.diff(times, prepend=times[0])
    path.write_text("".join(f"({step:.6f}) {line[2]}" for step, line in zip(steps, lines, strict=True)))
    with pytest.raises(ScanError, match=r"frames are earlier than the one before: times between frames"):
        read_log(path, HAND)
