"""Frames are decoded to volts for any layout, and classified."""

from pathlib import Path
from typing import Any

import can
import cantools
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.load_cells import CLASSIC, HEAD, data_of, protocol, strain_in, write_dbc

from tactile_localizer.io.can.layout import SignalNames
from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol
from tactile_localizer.io.status import FAULT, SATURATED
from tactile_localizer.resources import resource_path

PHALANGES_OF_A_HAND = tuple(
    message.name for message in cantools.database.load_file(resource_path("config/loadcells_fd.dbc")).messages
)


@st.composite
def signal_lines(
    draw: st.DrawFn, identifier: int, names: list[str], length: int
) -> tuple[list[str], list[str]]:
    """DBC lines of signals of any kind: little-endian in the lower bytes, big-endian in the upper ones."""
    border = 8 * draw(st.integers(1, length - 1))
    place, end = {1: 0, 0: border}, {1: border, 0: 8 * length}
    signals, types = [], []
    for i, name in enumerate(names):
        least = 4 * (len(names) - i - 1)  # leave room for the others
        order = max((1, 0), key=lambda order: end[order] - place[order])
        room = end[order] - place[order] - least
        floats = [bits for bits in (32, 64) if bits <= room and name.startswith("gauge")]
        is_float = bool(floats) and draw(st.booleans())
        bits = draw(st.sampled_from(floats) if is_float else st.integers(1, max(4, min(64, room))))
        bits = 4 if name == "counter" else bits  # of one width in all messages
        first = place[order] + draw(st.integers(0, max(0, min(9, room - bits))))
        place[order] = first + bits
        start = first if order else 8 * (first // 8) + 7 - first % 8
        # An integer of more than 53 bits that is scaled by an integer is more than a double holds.
        scale = draw(st.sampled_from([1, 0.5, 0.00025, -0.001, 1e-6] + [3] * (bits < 50)))
        offset = draw(st.sampled_from([0, 0.1, -1.5] + [7] * (bits < 50)))
        sign = "-" if is_float or (name.startswith("gauge") and draw(st.booleans())) else "+"
        scaling = f"({scale},{offset})" if name.startswith("gauge") else "(1,0)"
        signals.append(f' SG_ {name} : {start}|{bits}@{order}{sign} {scaling} [0|0] "V" hand')
        if is_float:
            types.append(f"SIG_VALTYPE_ {identifier} {name} : {bits // 32};")
    return signals, types


@st.composite
def layouts(draw: st.DrawFn) -> str:
    """A DBC of one phalanx: 8 gauges in one to four messages, with or without a counter and a status."""
    more = ["counter"] * draw(st.booleans()) + ["status"] * draw(st.booleans())
    parts = draw(st.sampled_from([1, 2, 4]))
    blocks, all_types = [], []
    for part in range(parts):
        gauges = [f"gauge_{i + 1}" for i in range(part * 8 // parts, (part + 1) * 8 // parts)]
        identifier = 0x80000000 + 70_000 + part if draw(st.booleans()) else 100 + part
        length = draw(st.sampled_from([8, 12, 16, 20, 24, 32, 48, 64]))
        names = draw(st.permutations(gauges + more))
        signals, types = draw(signal_lines(identifier, names, length))
        blocks.append("\n".join([f"BO_ {identifier} finger_{part}: {length} hand", *signals]))
        all_types += types
    return HEAD + "\n\n".join(blocks) + "\n\n" + "\n".join(all_types) + "\n"


@given(text=layouts(), seed=st.integers(0, 2**32 - 1))
def test_decoding_agrees_with_cantools(
    tmp_path_factory: pytest.TempPathFactory, text: str, seed: int
) -> None:
    path = write_dbc(tmp_path_factory.mktemp("dbc") / "random.dbc", text)
    database: Any = cantools.database.load_file(path)
    finger = LoadCellProtocol(path, ["finger"])
    rng = np.random.default_rng(seed)
    sent = [database.messages[i] for i in rng.integers(0, len(database.messages), 40)]
    frames = [
        can.Message(
            arbitration_id=message.frame_id,
            is_extended_id=message.is_extended_frame,
            data=rng.bytes(message.length),
        )
        for message in sent
    ]

    for message, frame in zip(sent, frames, strict=True):
        kind, slot, counter = finger.classify(frame)
        assert kind == FrameKind.DATA
        assert finger.messages[slot].definition.name == message.name
        expected = message.decode(frame.data, decode_choices=False)
        assert counter == expected.get("counter", 0)
        strain, status = finger.decode(data_of(finger, [frame]))
        gauges = {gauge.name: strain[column] for column, gauge in finger.messages[slot].gauges.items()}
        for name, value in gauges.items():
            np.testing.assert_equal(value, float(expected[name]))
        fault = expected.get("status", 0) != 0 or not np.isfinite(list(gauges.values())).all()
        assert bool(status[0] & FAULT) == fault


@pytest.mark.parametrize(("dbc", "resolution"), [("loadcells.dbc", 0.00025), ("loadcells_fd.dbc", 0.0000625)])
def test_encoding_and_decoding_are_inverse(dbc: str, resolution: float) -> None:
    hand = protocol(PHALANGES_OF_A_HAND, dbc)
    rng = np.random.default_rng(1)
    for phalanx in range(14):
        strain = rng.uniform(-2.0, 2.0, 8)
        frames = hand.encode(phalanx, strain, sequence=21)
        voltages, status = hand.decode(data_of(hand, frames))
        np.testing.assert_allclose(
            voltages[8 * phalanx : 8 * phalanx + 8], strain, atol=resolution / 2 + 1e-9
        )
        assert not status.any()
        counters = {hand.classify(frame)[2] for frame in frames}
        assert counters == {21 % 16 if dbc == "loadcells.dbc" else 21}


@pytest.mark.parametrize("dbc", ["loadcells.dbc", "loadcells_fd.dbc"])
def test_voltages_beyond_the_range_are_saturated(dbc: str) -> None:
    hand = protocol(["index"], dbc)
    voltages = np.zeros(8)
    voltages[6] = 5.0
    assert hand.decode(data_of(hand, hand.encode(0, voltages, sequence=0)))[1].tolist() == [SATURATED]


@pytest.mark.parametrize(
    ("gauge", "raw", "saturated"),
    [
        ("0|8@1+ (1,0) [0|0]", 0, False),  # a taxel without contact
        ("0|8@1+ (1,0) [0|255]", 0, False),
        ("0|8@1+ (1,0) [0|255]", 255, True),
        ("0|8@1+ (-1,0) [-255|0]", 0, False),
        ("0|8@1+ (-1,0) [-255|0]", 255, True),
        ("0|8@1+ (0.02,0.5) [0|0]", 0, False),  # a sensor whose zero is 0.5 V
        ("0|8@1+ (1,0) [2|250]", 2, True),  # the DBC says so
        ("0|8@1- (0.01,0) [-1|1]", 100, True),
        ("0|8@1- (0.01,0) [-1|1]", 156, True),
        ("0|8@1+ (0.01,-1.28) [0|0]", 0, True),  # offset binary rests in the middle
        ("0|8@1+ (0.01,-1.28) [0|0]", 128, False),
        ("0|8@1- (1,0) [0|0]", 128, True),
        ("0|8@1- (1,0) [0|0]", 0, False),
    ],
)
def test_rest_is_not_saturation(tmp_path: Path, gauge: str, raw: int, saturated: bool) -> None:
    path = write_dbc(tmp_path / "own.dbc", f'{HEAD}BO_ 16 index: 1 hand\n SG_ gauge_1 : {gauge} "" hand\n')
    status = LoadCellProtocol(path, ["index"]).decode(bytearray([raw]))[1]
    assert status.tolist() == [SATURATED * saturated]


def test_a_long_frame_is_padded_as_the_bus_does(tmp_path: Path) -> None:
    """CAN FD has no frames of 10 bytes."""
    gauge = 'BO_ 16 index: 10 hand\n SG_ gauge_1 : 64|16@1- (0.001,0) [0|0] "V" hand\n'
    hand = LoadCellProtocol(write_dbc(tmp_path / "own.dbc", HEAD + gauge), ["index"])
    (frame,) = hand.encode(0, np.array([1.5]), sequence=0)
    assert len(frame.data) == 12
    np.testing.assert_allclose(strain_in(hand, [frame]), 1.5)


def passes(hand: LoadCellProtocol, identifier: int, extended: bool) -> bool:
    return any(
        one["can_id"] & one["can_mask"] == identifier & one["can_mask"] and one.get("extended") == extended
        for one in hand.filters
    )


def test_filters_pass_the_messages_in_use_and_their_identifiers_of_another_length() -> None:
    hand = protocol(["middle"])
    passed = {
        (identifier, extended)
        for identifier in range(0x800)
        for extended in (False, True)
        if passes(hand, identifier, extended)
    }
    assert passed == {(number, extended) for number in (0x104, 0x105) for extended in (False, True)}


J1939 = (
    HEAD
    + """BO_ 2566852862 index: 8 hand
 SG_ gauge_1 : 0|16@1- (0.001,0) [0|0] "V" hand

BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_ "VFrameFormat" BO_ 2566852862 3;
"""
)


@pytest.mark.parametrize(
    ("dbc", "frame", "kind", "reason"),
    [
        (CLASSIC, {"data": bytes(4)}, FrameKind.WRONG_LENGTH, "0x102 index_a: 4 bytes instead of 8"),
        (CLASSIC, {"data": bytes(12)}, FrameKind.WRONG_LENGTH, "0x102 index_a: 12 bytes instead of 8"),
        (CLASSIC, {"is_remote_frame": True}, FrameKind.REMOTE, "0x102 index_a: remote frames"),
        (
            CLASSIC,
            {"is_extended_id": True},
            FrameKind.UNKNOWN_ID,
            "0x102 index_a: an identifier of 29 bits instead of 11",
        ),
        (
            CLASSIC.replace("BO_ 258", f"BO_ {258 + (1 << 31)}"),
            {},
            FrameKind.UNKNOWN_ID,
            "0x102 index_a: an identifier of 11 bits instead of 29",
        ),
        (
            J1939,
            {"arbitration_id": 0x18FF1021, "is_extended_id": True},
            FrameKind.UNKNOWN_ID,
            "0x18FF1021 differs from 0x18FF10FE index only in its priority or the address of its sender",
        ),
        (
            J1939,
            {"arbitration_id": 0xCFF1021, "is_extended_id": True},
            FrameKind.UNKNOWN_ID,
            "set messages.index to index@0xCFF1021",
        ),
    ],
)
def test_frames_that_resemble_a_message_are_explained(
    tmp_path: Path, dbc: str, frame: dict[str, Any], kind: FrameKind, reason: str
) -> None:
    hand = LoadCellProtocol(write_dbc(tmp_path / "own.dbc", dbc), ["index"])
    defaults = {"arbitration_id": 0x102, "is_extended_id": False, "data": bytes(8)}
    sent = can.Message(**{**defaults, **frame}, is_fd=len(frame.get("data", b"")) > 8)
    found, slot, _ = hand.classify(sent)
    assert found == kind
    assert passes(hand, sent.arbitration_id, sent.is_extended_id), "the kernel lets it pass"
    assert reason in hand.misfit(sent, slot)


def test_other_frames_resemble_no_message() -> None:
    for extended in (False, True):
        frame = can.Message(arbitration_id=0x302, is_extended_id=extended)
        assert protocol().classify(frame) == (FrameKind.UNKNOWN_ID, -1, 0)


STATUS = (
    HEAD
    + """BO_ 16 index: 8 hand
 SG_ gauge_1 : 0|16@1- (0.0001,0) [0|65535] "V" hand
 SG_ status : 32|2@1+ (1,0) [0|3] "" hand

VAL_ 16 status 0 "starting" 1 "valid" 2 "overload" 3 "broken wire" ;
"""
)


@pytest.mark.parametrize("ok", [(1,), (1, 2)])
def test_a_status_is_a_fault_unless_it_is_listed(tmp_path: Path, ok: tuple[int, ...]) -> None:
    names = SignalNames(status_ok=ok)
    hand = LoadCellProtocol(write_dbc(tmp_path / "own.dbc", STATUS), ["index"], names=names)
    for status, name in enumerate(("starting", "valid", "overload", "broken wire")):
        data = data_of(hand, hand.encode(0, np.array([1.0]), 0, status))
        assert hand.decode(data)[1].tolist() == [0 if status in ok else FAULT]
        assert hand.explain(0, data) == (
            "" if status in ok else f"status {status} ({name}) is not in status_ok"
        )


def test_saturation_is_explained_by_the_range_of_the_dbc(tmp_path: Path) -> None:
    hand = LoadCellProtocol(write_dbc(tmp_path / "own.dbc", STATUS), ["index"])
    data = bytearray((-1000).to_bytes(8, "little", signed=True))
    data[4:] = bytes(4)
    assert hand.decode(data)[1].tolist() == [SATURATED]
    assert hand.explain(0, data) == "gauge_1 is -0.1 V, with the range [0|65535] V in the DBC"
    hand = protocol(["index"], "loadcells_fd.dbc")
    voltages = np.zeros(8)
    voltages[6] = 5.0
    assert hand.explain(0, data_of(hand, hand.encode(0, voltages, sequence=0))).startswith("gauge_7 is 2.04")
