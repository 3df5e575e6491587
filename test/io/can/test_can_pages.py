"""Gauges behind a multiplexer: a sample is complete when a frame of each of its pages was received."""

from pathlib import Path

import can
import numpy as np
import pytest
from support.load_cells import HEAD, data_of, write_dbc

from tactile_localizer.errors import CanError
from tactile_localizer.io.can.assembler import Cycle, CycleAssembler
from tactile_localizer.io.can.layout import SignalNames
from tactile_localizer.io.can.log import read_log
from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol

T0_S = 1.7e9
PERIOD_S = 0.01
COUNTERS = {
    "none": "",
    "of every frame": ' SG_ counter : 48|8@1+ (1,0) [0|0] "" hand\n',
    "of the second page": ' SG_ counter m4 : 48|8@1+ (1,0) [0|0] "" hand\n',
}


def skin(folder: Path, counter: str = "of every frame", selector: str = "0|4@1+") -> LoadCellProtocol:
    """A skin of five gauges, of which two come with 1 in the first byte, two with 4, and one with both."""
    text = f'{HEAD}BO_ 256 index: 8 hand\n SG_ half M : {selector} (1,0) [0|0] "" hand\n'
    for n, page in enumerate(("m1 ", "m1 ", "m4 ", "m4 ", "")):
        place = 56 if n == 4 else 16 + 16 * (n % 2)
        text += f' SG_ gauge_{n + 1} {page}: {place}|{8 if n == 4 else 16}@1- (0.001,0) [0|0] "V" hand\n'
    text += f' SG_ temperature m2 : 16|16@1- (1,0) [0|0] "degC" hand\n{COUNTERS[counter]}'
    return LoadCellProtocol(write_dbc(folder / "skin.dbc", text), ["index"])


def volts(number: int) -> np.ndarray:
    return 0.001 * np.array([*(10 * number + np.arange(4)), number % 100])


def frames_of(hand: LoadCellProtocol, numbers: range, apart_s: float = 3e-4) -> list[can.Message]:
    """Frames of samples, each sample followed by one of the temperature."""
    found = []
    for number in numbers:
        stamp_s = T0_S + number * PERIOD_S
        own = hand.encode(0, volts(number), number, stamp_s=stamp_s)
        other = can.Message(arbitration_id=256, is_extended_id=False, data=b"\x22" + bytes(7))
        for k, frame in enumerate([*own, other]):
            frame.timestamp = stamp_s + k * apart_s
            found.append(frame)
    return found


def cycles_of(hand: LoadCellProtocol, frames: list[can.Message]) -> list[Cycle]:
    assembler = CycleAssembler(hand)
    cycles = assembler.feed(frames)
    assembler.reset()
    return cycles + assembler.feed([])


@pytest.mark.parametrize("counter", COUNTERS)
@pytest.mark.parametrize("selector", ["0|4@1+", "3|4@0+"])
@pytest.mark.parametrize("apart_s", [3e-4, PERIOD_S / 3])
def test_a_sample_has_all_its_pages(tmp_path: Path, counter: str, selector: str, apart_s: float) -> None:
    hand = skin(tmp_path, counter, selector)
    assert hand.channels.counts == (5,)
    cycles = cycles_of(hand, frames_of(hand, range(100), apart_s))
    whole = [one.strain for one in cycles if not one.status.any()]
    assert len(whole) >= 98
    for strain in whole:
        np.testing.assert_allclose(strain, volts(round(100 * strain[0])), atol=1e-9)


@pytest.mark.parametrize("counter", COUNTERS)
def test_a_sample_that_lacks_a_page_is_missing(tmp_path: Path, counter: str) -> None:
    hand = skin(tmp_path, counter)
    frames = frames_of(hand, range(100))
    del frames[3 * 50]
    del frames[3 * 70]  # the second page of sample 70, as the first of 50 is gone
    cycles = cycles_of(hand, frames)
    whole = [one.strain for one in cycles if not one.status.any()]
    assert len(whole) >= 96
    for strain in whole:
        np.testing.assert_allclose(strain, volts(round(100 * strain[0])), atol=1e-9)


def test_a_log_is_read_by_its_pages(tmp_path: Path) -> None:
    hand = skin(tmp_path)
    with can.Logger(tmp_path / "skin.log") as log:
        for frame in frames_of(hand, range(100)):
            log.on_message_received(frame)
    read = read_log(tmp_path / "skin.log", hand)
    assert len(read.strain) >= 98
    assert np.isfinite(read.strain).all()
    assert not read.notes


def test_a_page_without_gauges_is_named_where_there_is_no_other(tmp_path: Path) -> None:
    hand = skin(tmp_path)
    frame = frames_of(hand, range(1))[2]
    kind, slot, _ = hand.classify(frame)
    assert kind == FrameKind.UNKNOWN_PAGE
    assert hand.misfit(frame, slot) == "0x100 index: half 2 instead of 1, 4"


def test_pages_can_belong_to_several_phalanges(tmp_path: Path) -> None:
    text = (
        HEAD
        + """BO_ 256 hand: 8 hand
 SG_ finger M : 0|8@1+ (1,0) [0|0] "" hand
 SG_ index_1 m0 : 8|16@1- (0.001,0) [0|0] "V" hand
 SG_ thumb_1 m1 : 8|16@1- (0.001,0) [0|0] "V" hand
"""
    )

    names = SignalNames(("{phalanx}_1",))
    path, messages = write_dbc(tmp_path / "own.dbc", text), {"index": ["hand"], "thumb": ["hand"]}
    hand = LoadCellProtocol(path, ["index", "thumb"], messages, names)
    frames = [hand.encode(p, np.array([one]), 0)[0] for p, one in enumerate((1.5, -0.5))]
    assert hand.decode(data_of(hand, frames))[0].tolist() == [1.5, -0.5]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("counter m2 :", "signal 'counter' of index: expected it in every frame or with gauges"),
        ("gauge_6 m2m3M :", "behind one multiplexer|expected a DBC file"),
    ],
)
def test_pages_that_cannot_be_told_apart_are_refused(tmp_path: Path, text: str, reason: str) -> None:
    skin(tmp_path)
    path = tmp_path / "skin.dbc"
    path.write_text(path.read_text().replace("counter :", text))
    with pytest.raises(CanError, match=reason):
        LoadCellProtocol(path, ["index"])
