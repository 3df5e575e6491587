"""Recorded CAN logs are read in the formats of python-can, with their stamps."""

from pathlib import Path

import can
import numpy as np
import pytest
from support.load_cells import PERIOD_NS, START_NS, cycle, number_of, protocol

from tactile_localizer.errors import ScanError
from tactile_localizer.io.can.log import read_log

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


def frames_of(numbers: range) -> list[can.Message]:
    return [frame for number in numbers for frame in cycle(HAND, number)]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_each_cycle_of_a_log_is_a_strain_vector_with_its_stamp(tmp_path: Path, suffix: str) -> None:
    path = recorded(tmp_path / f"sweep.{suffix}", frames_of(range(2500)))
    shown: list[float] = []
    stamp_ns, strain, notes = read_log(path, HAND, progress=lambda text, fraction: shown.append(fraction))
    numbers = [number_of(0, vector[:8]) for vector in strain]
    assert numbers == [number_of(1, vector[8:]) for vector in strain]
    assert np.ptp(np.diff(numbers) % 1000) == 0
    assert len(strain) >= 2498, "all but the first ones, before the period is known"
    expected_ns = START_NS + np.arange(2500 - len(strain), 2500) * PERIOD_NS
    np.testing.assert_allclose(stamp_ns - expected_ns, 0, atol=1_000_000)
    assert not notes
    assert shown == sorted(shown)
    assert 0 < shown[0] <= shown[-1] <= 1


def test_what_is_no_strain_is_missing_and_losses_are_noted(tmp_path: Path) -> None:
    frames = frames_of(range(100))
    del frames[4 * 50]
    error = can.Message(timestamp=START_NS * 1e-9, is_error_frame=True)
    faulty = HAND.encode(1, np.zeros(8), 100, status=2, stamp_s=1e-9 * (START_NS + 100 * PERIOD_NS))
    path = recorded(tmp_path / "sweep.log", [error, *frames, *cycle(HAND, 100)[:2], *faulty], "can0")
    _, strain, notes = read_log(path, HAND)
    assert np.isnan(strain).sum() == 16
    assert np.isnan(strain[-1, 8:]).all()
    assert notes == [f"{path}: 1 frames of index lost"]


def test_a_damaged_log_is_read_up_to_there(tmp_path: Path) -> None:
    path = recorded(tmp_path / "sweep.log", frames_of(range(1001)), "can0")
    whole = path.read_text()
    for damage in ("(1700000005.0", "(1700000005.0\n" + whole):
        path.write_text(whole + damage)
        _, strain, (note,) = read_log(path, HAND)
        assert len(strain) >= 999
        assert f"{path}: expected a log that python-can reads" in note


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
