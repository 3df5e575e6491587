"""Frames are decoded to volts for any layout, and classified."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from typing import Any

import can
import cantools
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.load_cells import protocol

from tactile_localizer.errors import CanError
from tactile_localizer.io.can.frames import MAX_BYTES
from tactile_localizer.io.can.layout import SignalNames
from tactile_localizer.io.can.protocol import Decoded, FrameKind, LoadCellProtocol
from tactile_localizer.resources import resource_path

HEAD = 'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: hand\n\n'
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


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def strain_in(hand: LoadCellProtocol, frames: list[Decoded]) -> np.ndarray:
    """The strain vector, V, from decoded frames; NaN where there is none."""
    strain = np.full(hand.channels.size, np.nan)
    for frame in frames:
        strain[[gauge.column for gauge in hand.messages[frame.slot].gauges]] = frame.voltage
    return strain


@given(text=layouts(), seed=st.integers(0, 2**32 - 1))
def test_decoding_agrees_with_cantools(
    tmp_path_factory: pytest.TempPathFactory, text: str, seed: int
) -> None:
    path = write(tmp_path_factory.mktemp("dbc") / "random.dbc", text)
    database: Any = cantools.database.load_file(path)
    finger = LoadCellProtocol.from_dbc(path, ["finger"])
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
        decoded = finger.decode(frame)
        assert decoded.kind == FrameKind.DATA
        expected = message.decode(frame.data, decode_choices=False)
        assert finger.message_names[decoded.slot] == message.name
        gauges = [gauge.signal.name for gauge in finger.messages[decoded.slot].gauges]
        for gauge, value in expected.items():
            if gauge == "counter":
                assert decoded.counter == value
            elif gauge.startswith("gauge"):
                np.testing.assert_equal(decoded.voltage[gauges.index(gauge)], float(value))


@pytest.mark.parametrize(("dbc", "resolution"), [("loadcells.dbc", 0.00025), ("loadcells_fd.dbc", 0.0000625)])
def test_encoding_and_decoding_are_inverse(dbc: str, resolution: float) -> None:
    hand = protocol(PHALANGES_OF_A_HAND, dbc)
    rng = np.random.default_rng(1)
    for phalanx in range(14):
        strain = rng.uniform(-2.0, 2.0, 8)
        decoded = [hand.decode(frame) for frame in hand.encode(phalanx, strain, sequence=21)]
        voltages = strain_in(hand, decoded)
        np.testing.assert_allclose(
            voltages[8 * phalanx : 8 * phalanx + 8], strain, atol=resolution / 2 + 1e-9
        )
        assert np.isnan(voltages).sum() == 13 * 8
        assert {one.counter for one in decoded} == {21 % 16 if dbc == "loadcells.dbc" else 21}
        assert not any(one.saturated or one.fault for one in decoded)


@pytest.mark.parametrize("dbc", ["loadcells.dbc", "loadcells_fd.dbc"])
def test_voltages_beyond_the_range_are_saturated(dbc: str) -> None:
    hand = protocol(["index"], dbc)
    strain = np.zeros(8)
    strain[6] = 5.0
    decoded = [hand.decode(frame) for frame in hand.encode(0, strain, sequence=0)]
    assert any(one.saturated for one in decoded)
    assert hand.saturated(strain_in(hand, decoded)).tolist() == [False] * 6 + [True, False]


def test_nonzero_status_is_a_fault() -> None:
    hand = protocol(["index"])
    assert all(hand.decode(frame).fault for frame in hand.encode(0, np.zeros(8), sequence=0, status=3))


def test_frames_are_classified() -> None:
    hand = protocol()
    key = hand.encode(0, np.zeros(8), sequence=0)[0].arbitration_id
    frames = {
        FrameKind.DATA: can.Message(arbitration_id=key, is_extended_id=False, data=bytes(8)),
        FrameKind.UNKNOWN_ID: can.Message(arbitration_id=key, is_extended_id=True, data=bytes(8)),
        FrameKind.WRONG_LENGTH: can.Message(arbitration_id=key, is_extended_id=False, data=bytes(6)),
        FrameKind.REMOTE: can.Message(arbitration_id=key, is_extended_id=False, is_remote_frame=True, dlc=8),
        FrameKind.ERROR: can.Message(
            arbitration_id=key, is_extended_id=False, is_error_frame=True, data=bytes(8)
        ),
    }
    assert [hand.decode(frame).kind for frame in frames.values()] == list(frames)


def test_arbitrary_bytes_decode_without_error() -> None:
    hand = protocol(PHALANGES_OF_A_HAND)
    rng = np.random.default_rng(2)
    known = [message.key for message in hand.messages]
    for key in [*rng.choice(known, 2_000).tolist(), *rng.integers(0, 2**29, 2_000).tolist()]:
        data = rng.bytes(int(rng.choice([8, rng.integers(0, MAX_BYTES + 1)])))
        frame = can.Message(arbitration_id=key, is_extended_id=key > 0x7FF, data=data)
        assert hand.decode(frame).kind in FrameKind


def test_filters_pass_exactly_the_messages_in_use() -> None:
    hand = protocol(["middle"])
    passed = {
        (identifier, extended)
        for identifier in range(0x800)
        for extended in (False, True)
        if any(
            f["can_id"] == identifier & f["can_mask"] and f.get("extended") == extended for f in hand.filters
        )
    }
    assert passed == {(0x104, False), (0x105, False)}


def test_millivolts_are_converted_to_volts(tmp_path: Path) -> None:
    text = resource_path("config/loadcells.dbc").read_text()
    text = text.replace('(0.00025,0) [-2.048|2.04775] "V"', '(0.25,0) [-2048|2047.75] "mV"')
    hand = LoadCellProtocol.from_dbc(write(tmp_path / "mv.dbc", text), ["index"])
    decoded = [hand.decode(frame) for frame in hand.encode(0, np.full(8, 1.25), sequence=0)]
    np.testing.assert_allclose(strain_in(hand, decoded), 1.25)


def test_names_of_signals_and_messages_are_configurable(tmp_path: Path) -> None:
    text = resource_path("config/loadcells.dbc").read_text()
    text = text.replace("gauge_", "index_sg").replace("index_a", "LC_LOW").replace("index_b", "LC_HIGH")
    names = SignalNames(tuple(f"{{phalanx}}_sg{i}" for i in range(1, 9)))
    path = write(tmp_path / "own.dbc", text)
    hand = LoadCellProtocol.from_dbc(path, ["index"], {"index": ["LC_LOW", "LC_HIGH"]}, names)
    assert hand.message_names == ("LC_LOW", "LC_HIGH")
    strain = np.linspace(-1, 1, 8).round(3)
    decoded = [hand.decode(frame) for frame in hand.encode(0, strain, sequence=0)]
    np.testing.assert_allclose(strain_in(hand, decoded), strain)


def test_the_documented_example_is_a_dbc(tmp_path: Path) -> None:
    text = Path(__file__).parents[3].joinpath("docs", "can.md").read_text()
    begin = text.index('VERSION ""')
    path = write(tmp_path / "own.dbc", text[begin : text.index("```", begin)])
    hand = LoadCellProtocol.from_dbc(path, ["index"])
    strain = np.linspace(-3, 3, 8).round(4)
    decoded = [hand.decode(frame) for frame in hand.encode(0, strain, sequence=0)]
    np.testing.assert_allclose(strain_in(hand, decoded), strain, atol=1e-9)


CLASSIC = resource_path("config/loadcells.dbc").read_text()
BAD_DATABASES = {
    "no such file": (None, "expected a DBC file, No such file"),
    "not a DBC": ("gauges: 8\n", "expected a DBC file"),
    "another hand": (CLASSIC.replace("index_a", "pinky_a").replace("index_b", "pinky_b"), "'index'.*index_a"),
    "a gauge too few": (CLASSIC.replace("gauge_7", "gauge_9"), "'gauge_7' once in index_a, index_b, found 0"),
    "a gauge twice": (CLASSIC.replace("gauge_8", "gauge_1"), "'gauge_1' once in index_a, index_b, found 2"),
    "newtons": (CLASSIC.replace('"V"', '"N"'), "unit of V, mV or uV, found 'N'"),
    "a scale of 0": (CLASSIC.replace("(0.00025,0)", "(0,0)"), "'gauge_1' .* scale other than 0"),
    "one counter": (CLASSIC.replace("counter", "count", 3), "'counter' of one width in all"),
    "one identifier": (CLASSIC.replace("BO_ 259", "BO_ 258"), "0x102: expected one message"),
    "multiplexed": (
        CLASSIC.replace("gauge_1 :", "gauge_1 m0 :").replace("counter :", "counter M :"),
        "no multiplexed signals",
    ),
}


GAUGE_1 = "gauge_1 : 0|14@1-"
IMPOSSIBLE_SIZES = {
    "a signal of 4 Gbit": (
        GAUGE_1,
        "gauge_1 : 56|4294967295@1+",
        "signal 'gauge_1': .* got 4294967295 at 56",
    ),
    "a signal far away": (GAUGE_1, "gauge_1 : 4294967295|14@1-", "signal 'gauge_1': .* got 14 at 4294967295"),
    "5000 digits": (GAUGE_1, f"gauge_1 : 0|{'9' * 5000}@1-", "signal 'gauge_1': expected at most"),
    "spaces between": (GAUGE_1, "gauge_1:\n 0 | +4294967295 @ 1-", "signal 'gauge_1': expected at most"),
    "on one line": ("BO_ 258 index_a: 8 hand\n", "BO_ 258 index_a: 8 hand ", None),
    "a message of 4 GB": ("index_a: 8 ", "index_a: 4294967295 ", "message 'index_a': expected at most"),
    "as many multiplexed values": (
        'VAL_TABLE_ nothing 0 "none" ;',
        "SG_MUL_VAL_ 258 gauge_1 counter 0-4294967295;",
        "multiplexed values 0-4294967295: expected at most",
    ),
    "80 bits": (
        GAUGE_1,
        "gauge_1 : 0|80@1-",
        "DBC file|'gauge_1' of index_a, index_b: expected at most 64 bits, found 80",
    ),
}


@pytest.mark.parametrize("name", IMPOSSIBLE_SIZES)
def test_sizes_are_checked_before_allocation(tmp_path: Path, name: str) -> None:
    old, new, reason = IMPOSSIBLE_SIZES[name]
    text = CLASSIC.replace(old, new, 1) if old in CLASSIC else CLASSIC + new + "\n"
    path = write(tmp_path / "large.dbc", text)
    tracemalloc.start()
    try:
        if reason is None:
            LoadCellProtocol.from_dbc(path, ["index"])
        else:
            with pytest.raises(CanError, match=reason) as refusal:
                LoadCellProtocol.from_dbc(path, ["index"])
            assert "\n" not in str(refusal.value)
            assert len(str(refusal.value)) < 300
        assert tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("name", BAD_DATABASES)
def test_unusable_databases_are_refused(tmp_path: Path, name: str) -> None:
    text, reason = BAD_DATABASES[name]
    path = tmp_path / "bad.dbc"
    if text is not None:
        write(path, text)
    with pytest.raises(CanError, match=reason) as refusal:
        LoadCellProtocol.from_dbc(path, ["index"])
    assert "\n" not in str(refusal.value)


def test_a_message_belongs_to_one_phalanx() -> None:
    path = resource_path("config/loadcells.dbc")
    with pytest.raises(CanError, match="'index_a': expected one phalanx, found 'index' and 'other'"):
        LoadCellProtocol.from_dbc(path, ["index", "other"], {"other": ["index_a"]})
