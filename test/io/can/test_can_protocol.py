"""Frames are decoded to volts for any layout, and classified."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import can
import cantools
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.load_cells import data_of, protocol

from tactile_localizer.errors import CanError
from tactile_localizer.io.can.layout import SignalNames
from tactile_localizer.io.can.protocol import FrameKind, LoadCellProtocol
from tactile_localizer.io.status import FAULT, SATURATED
from tactile_localizer.resources import resource_path

HEAD = 'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: hand\n\n'
CLASSIC = resource_path("config/loadcells.dbc").read_text()
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


def strain_in(hand: LoadCellProtocol, frames: list[can.Message]) -> np.ndarray:
    """The strain vector, V, of a cycle with these frames."""
    return hand.decode(data_of(hand, frames))[0]


@given(text=layouts(), seed=st.integers(0, 2**32 - 1))
def test_decoding_agrees_with_cantools(
    tmp_path_factory: pytest.TempPathFactory, text: str, seed: int
) -> None:
    path = write(tmp_path_factory.mktemp("dbc") / "random.dbc", text)
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


def test_the_range_of_the_dbc_is_that_of_the_amplifier(tmp_path: Path) -> None:
    path = write(tmp_path / "own.dbc", CLASSIC.replace("[-2.048|2.04775]", "[-1|1]"))
    hand = LoadCellProtocol(path, ["index"])
    for volts in (-1.5, 1.5):
        frames = hand.encode(0, np.full(8, volts), sequence=0)
        assert hand.decode(data_of(hand, frames))[1].tolist() == [SATURATED]


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
        ("0|8@1+ (0.01,-1.28) [0|0]", 0, True),  # offset binary rests in the middle
        ("0|8@1+ (0.01,-1.28) [0|0]", 128, False),
        ("0|8@1- (1,0) [0|0]", 128, True),
        ("0|8@1- (1,0) [0|0]", 0, False),
    ],
)
def test_rest_is_not_saturation(tmp_path: Path, gauge: str, raw: int, saturated: bool) -> None:
    path = write(tmp_path / "own.dbc", f'{HEAD}BO_ 16 index: 1 hand\n SG_ gauge_1 : {gauge} "" hand\n')
    status = LoadCellProtocol(path, ["index"]).decode(bytearray([raw]))[1]
    assert status.tolist() == [SATURATED * saturated]


def test_a_long_frame_is_padded_as_the_bus_does(tmp_path: Path) -> None:
    """CAN FD has no frames of 10 bytes."""
    gauge = 'BO_ 16 index: 10 hand\n SG_ gauge_1 : 64|16@1- (0.001,0) [0|0] "V" hand\n'
    hand = LoadCellProtocol(write(tmp_path / "own.dbc", HEAD + gauge), ["index"])
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
    hand = LoadCellProtocol(write(tmp_path / "own.dbc", dbc), ["index"])
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
    hand = LoadCellProtocol(write(tmp_path / "own.dbc", STATUS), ["index"], names=names)
    for status, name in enumerate(("starting", "valid", "overload", "broken wire")):
        data = data_of(hand, hand.encode(0, np.array([1.0]), 0, status))
        assert hand.decode(data)[1].tolist() == [0 if status in ok else FAULT]
        assert hand.explain(0, data) == (
            "" if status in ok else f"status {status} ({name}) is not in status_ok"
        )


def test_saturation_is_explained_by_the_range_of_the_dbc(tmp_path: Path) -> None:
    hand = LoadCellProtocol(write(tmp_path / "own.dbc", STATUS), ["index"])
    data = bytearray((-1000).to_bytes(8, "little", signed=True))
    data[4:] = bytes(4)
    assert hand.decode(data)[1].tolist() == [SATURATED]
    assert hand.explain(0, data) == "gauge_1 is -0.1 V, with the range [0|65535] V in the DBC"
    hand = protocol(["index"], "loadcells_fd.dbc")
    voltages = np.zeros(8)
    voltages[6] = 5.0
    assert hand.explain(0, data_of(hand, hand.encode(0, voltages, sequence=0))).startswith("gauge_7 is 2.04")


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("unit", ["mV", "uV", "\u00b5V", "\u03bcV"])
def test_other_units_are_converted_to_volts(tmp_path: Path, unit: str, encoding: str) -> None:
    if unit == "\u03bcV" and encoding == "cp1252":
        return  # which has no Greek letters
    scaling = "(0.25,0) [-2048|2047.75]" if unit == "mV" else "(250,0) [-2048000|2047750]"
    text = CLASSIC.replace('(0.00025,0) [-2.048|2.04775] "V"', f'{scaling} "{unit}"')
    data = text.encode(encoding)
    if encoding == "utf-8":
        data += 'CM_ "K\xf6rper";\n'.encode("cp1252")  # as by another editor
    (tmp_path / "own.dbc").write_bytes(data)
    hand = LoadCellProtocol(tmp_path / "own.dbc", ["index"])
    np.testing.assert_allclose(strain_in(hand, hand.encode(0, np.full(8, 1.25), sequence=0)), 1.25)


def test_names_of_signals_and_messages_are_configurable(tmp_path: Path) -> None:
    text = CLASSIC.replace("gauge_", "index_sg").replace("index_a", "LC_LOW").replace("index_b", "LC_HIGH")
    names = SignalNames(tuple(f"{{phalanx}}_sg{i}" for i in range(1, 9)))
    path = write(tmp_path / "own.dbc", text)
    hand = LoadCellProtocol(path, ["index"], {"index": ["LC_LOW", "LC_HIGH"]}, names)
    assert [message.definition.name for message in hand.messages] == ["LC_LOW", "LC_HIGH"]
    strain = np.linspace(-1, 1, 8).round(3)
    np.testing.assert_allclose(strain_in(hand, hand.encode(0, strain, sequence=0)), strain)


def test_the_documented_example_is_a_dbc(tmp_path: Path) -> None:
    text = Path(__file__).parents[3].joinpath("docs", "can.md").read_text()
    begin = text.index('VERSION ""')
    path = write(tmp_path / "own.dbc", text[begin : text.index("```", begin)])
    hand = LoadCellProtocol(path, ["index"])
    strain = np.array([-3.0, 2.5])
    np.testing.assert_allclose(strain_in(hand, hand.encode(0, strain, sequence=0)), strain, atol=1e-9)


FLOAT_COUNTER = """BO_ 16 index: 8 hand
 SG_ gauge_1 : 0|16@1- (1,0) [0|0] "V" hand
 SG_ counter : 32|32@1- (1,0) [0|0] "" hand

SIG_VALTYPE_ 16 counter : 1;
"""
FLOATS_OF_ANOTHER = """BO_ 16 index: 8 hand
 SG_ gauge_1 : 0|32@1- (1,0) [0|0] "mV" hand

SIG_VALTYPE_ 17 gauge_1 : 1;
"""
BAD_DATABASES = {
    "no such file": (None, "expected a DBC file, No such file"),
    "not a DBC": ("gauges: 8\n", "expected a DBC file"),
    "another hand": (CLASSIC.replace("index_a", "pinky_a").replace("index_b", "pinky_b"), "'index'.*index_a"),
    "a gauge too few": (CLASSIC.replace("gauge_7", "gauge_9"), "'gauge_7' once in index_a, index_b, found 0"),
    "a gauge twice": (CLASSIC.replace("gauge_8", "gauge_1"), "'gauge_1' once in index_a, index_b, found 2"),
    "newtons": (CLASSIC.replace('"V"', '"N"'), "unit of V, mV or uV, found 'N'"),
    "a scale of 0": (CLASSIC.replace("(0.00025,0)", "(0,0)"), "'gauge_1' .* scale other than 0"),
    "a counter with a scale of 0": (
        CLASSIC.replace("56|4@1+ (1,0)", "56|4@1+ (0,0)"),
        "'counter' of index_a: expected a scale other than 0",
    ),
    "a float as counter": (HEAD + FLOAT_COUNTER, "expected an integer 'counter', found a float"),
    "one identifier": (
        CLASSIC.replace("BO_ 259", "BO_ 258"),
        "'index_a'.* found index_a 0x102, index_b 0x102",
    ),
    "the identifier of an unused message": (
        CLASSIC.replace("BO_ 260 ", "BO_ 258 "),
        "expected its name and identifier once in the DBC, found index_a 0x102, middle_a 0x102",
    ),
    "a name twice": (
        CLASSIC.replace("middle_a", "index_a"),
        "'index_a': expected its name and .* found index_a 0x102, index_a 0x104",
    ),
    "a counter twice": (
        CLASSIC.replace("status :", "counter :"),
        "counter and counter are overlapping in message index_a",
    ),
    "overlapping signals": (
        CLASSIC.replace("gauge_2 : 14", "gauge_2 : 10"),
        "gauge_2 and gauge_1 are overlapping",
    ),
    "an empty range": (CLASSIC.replace("[-2.048|2.04775]", "[2|-2]"), r"below the maximum, found \[2\|-2\]"),
    "floats of another message": (HEAD + FLOATS_OF_ANOTHER, "'gauge_1' of index.*found that of message 17"),
    "an empty file": ("", "expected a DBC file, found no messages"),
    "80 bits": (
        CLASSIC.replace("gauge_1 : 0|14@1-", "gauge_1 : 0|80@1-"),
        "DBC file|'gauge_1' of index_a: expected at most 64 bits, found 80",
    ),
    "a million bits": (
        CLASSIC.replace("gauge_1 : 0|14", "gauge_1 : 0|1000000"),
        "found 1000000 from bit 0",
    ),
    "a place far away": (
        CLASSIC.replace("gauge_1 : 0|", "gauge_1 : 10000000000|"),
        "found 14 from bit 10000000000",
    ),
    "a number of 5000 digits": (
        CLASSIC.replace("gauge_1 : 0|14", "gauge_1 : 0|" + "9" * 5000),
        "1 to 512 bits",
    ),
    "a frame of many bytes": (
        CLASSIC.replace("index_a: 8", "index_a: 100000000"),
        "at most 64 bytes, found 100000000",
    ),
    "multiplexed": (
        CLASSIC.replace("gauge_1 :", "gauge_1 m0 :").replace("counter :", "counter M :"),
        "'gauge_1' of index_a: expected it in every frame, it is multiplexed",
    ),
}


@pytest.mark.parametrize("name", BAD_DATABASES)
def test_unusable_databases_are_refused(tmp_path: Path, name: str) -> None:
    text, reason = BAD_DATABASES[name]
    path = tmp_path / "bad.dbc"
    if text is not None:
        write(path, text)
    with pytest.raises(CanError, match=reason) as refusal:
        LoadCellProtocol(path, ["index"])
    assert "\n" not in str(refusal.value)


DAMAGE = [
    "9",
    "-",
    "|",
    "@",
    "m0",
    "M",
    '"',
    ";",
    "99999999999",
    "\n",
    "SG_ ",
    "BO_ ",
    "\xff",
    "\0",
    "index",
    "",
]


@given(
    damage=st.lists(
        st.tuples(st.floats(0, 1), st.integers(0, 40), st.sampled_from(DAMAGE)), min_size=1, max_size=4
    )
)
def test_a_damaged_dbc_is_read_or_refused_in_one_line(
    tmp_path_factory: pytest.TempPathFactory, damage: list[tuple[float, int, str]]
) -> None:
    text = HEAD + BESIDE_TEMPERATURE
    for place, length, put in damage:
        begin = int(place * len(text))
        text = text[:begin] + put + text[begin + length :]
    path = write(tmp_path_factory.mktemp("dbc") / "damaged.dbc", text)
    try:
        hand = LoadCellProtocol(path, ["index"])
    except CanError as refusal:
        assert "\n" not in str(refusal)  # noqa: PT017
    else:
        hand.decode(bytes(hand.size))


FAULTS_OF_OTHERS = {
    "overlapping signals": "BO_ 1 motor: 8 hand\n"
    + "".join(f' SG_ {name} : 0|9@1- (1,0) [0|0] "" hand\n' for name in "ab"),
    "a signal outside of its message": 'BO_ 1 motor: 2 hand\n SG_ a : 12|9@1- (1,0) [0|0] "" hand\n',
    "a signal without bits": 'BO_ 1 motor: 2 hand\n SG_ a : 0|0@1- (1,0) [0|0] "" hand\n',
    "a million bits": 'BO_ 1 motor: 2 hand\n SG_ a : 0|1000000@1- (1,0) [0|0] "" hand\n',
    "many bytes": "BO_ 1 motor: 1000000000 hand\n",
    "an identifier that is too long": "BO_ 419361280 motor: 8 hand\n",
    "a name twice": "BO_ 1 motor: 8 hand\n\nBO_ 2 motor: 8 hand\n",
    "an identifier twice": "BO_ 1 motor: 8 hand\n\nBO_ 1 engine: 8 hand\n",
    "an empty range": 'BO_ 1 motor: 8 hand\n SG_ a : 0|8@1- (1,0) [9|1] "" hand\n',
    "a syntax error": 'BO_ 1 motor: 8 hand\n SG_ a : 0|8@1 (1;0) [] "" hand\n',
    "multiplexed values": "BO_ 1 motor: 8 hand\n\nSG_MUL_VAL_ 1 a b 0-4000000000;\n",
    "a removed message": "SIG_VALTYPE_ 1 gauge_1 : 1;\n",
    "a text": 'BO_ 1 motor: 8 hand\n\nCM_ "until 2020:\nBO_ 258 index_a: 4 hand\n";\n',
    "a comment": "// BO_ 258 index_a: 4 hand\n",
}


@pytest.mark.parametrize("name", FAULTS_OF_OTHERS)
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_faults_in_messages_that_are_not_used_do_not_matter(tmp_path: Path, name: str, end: str) -> None:
    (tmp_path / "robot.dbc").write_bytes(
        (CLASSIC + "\n" + FAULTS_OF_OTHERS[name]).replace("\n", end).encode()
    )
    hand = LoadCellProtocol(tmp_path / "robot.dbc", ["index"])
    strain = np.linspace(-1, 1, 8).round(3)
    np.testing.assert_allclose(strain_in(hand, hand.encode(0, strain, sequence=0)), strain)


BESIDE_TEMPERATURE = """BO_ 16 index: 8 hand
 SG_ gauge_1 : 0|16@1- (0.001,0) [0|0] "V" hand
 SG_ page M : 32|8@1+ (1,0) [0|0] "" hand
 SG_ temperature m1 : 40|16@1- (0.1,0) [0|0] "degC" hand
 SG_ serial_number m2 : 40|24@1+ (1,0) [0|0] "" hand

SG_MUL_VAL_ 16 serial_number page 2-4000000000;
"""


def test_gauges_of_every_frame_are_read_beside_multiplexed_signals(tmp_path: Path) -> None:
    hand = LoadCellProtocol(write(tmp_path / "own.dbc", HEAD + BESIDE_TEMPERATURE), ["index"])
    frames = hand.encode(0, np.array([1.5]), sequence=0)
    np.testing.assert_allclose(strain_in(hand, frames), 1.5)


def taxels(count: int, axes: str = "xyz") -> str:
    """A DBC with a message for each taxel, all of them with the same signals."""
    lines = []
    for taxel in range(count):
        lines.append(f"BO_ {16 + taxel} index_{taxel}: 8 hand")
        lines += [f' SG_ {axis} : {16 * i}|16@1- (0.001,0) [0|0] "V" hand' for i, axis in enumerate(axes)]
    return HEAD + "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("gauges", "expected"),
    [
        (["x", "y", "z"], "0x 0y 0z 1x 1y 1z"),
        (["z", "x"], "0z 0x 1z 1x"),
        (["{phalanx}_1.x", "{phalanx}_0.x"], "1x 0x"),
    ],
)
def test_signals_of_one_name_in_each_message_are_channels(
    tmp_path: Path, gauges: list[str], expected: str
) -> None:
    hand = LoadCellProtocol(
        write(tmp_path / "own.dbc", taxels(2)), ["index"], names=SignalNames(tuple(gauges))
    )
    found = {
        column: f"{slot}{gauge.name}"
        for slot, message in enumerate(hand.messages)
        for column, gauge in message.gauges.items()
    }
    assert [found[column] for column in range(hand.channels.size)] == expected.split()
    strain = np.arange(hand.channels.size) * 0.1
    np.testing.assert_allclose(strain_in(hand, hand.encode(0, strain, sequence=0)), strain, atol=1e-9)


def test_messages_of_a_phalanx_are_numbered(tmp_path: Path) -> None:
    text = taxels(12) + 'BO_ 99 index_tip: 8 hand\n SG_ x : 0|16@1- (1,0) [0|0] "V" hand\n'
    hand = LoadCellProtocol(write(tmp_path / "own.dbc", text), ["index"], names=SignalNames(("x", "y", "z")))
    assert hand.channels.size == 36


def test_boards_of_one_kind_share_a_message(tmp_path: Path) -> None:
    text = HEAD + 'BO_ 385 STRAIN: 4 hand\n SG_ gauge_1 : 0|16@1- (0.001,0) [0|0] "V" hand\n'
    path = write(tmp_path / "board.dbc", text)
    messages = {"thumb": ["STRAIN"], "index": ["STRAIN@0x182"], "middle": ["STRAIN@0x12345678"]}
    hand = LoadCellProtocol(path, list(messages), messages)
    assert [message.key for message in hand.messages] == [(0x181, False), (0x182, False), (0x12345678, True)]
    for phalanx in range(3):
        (frame,) = hand.encode(phalanx, np.array([1.5]), sequence=0)
        assert hand.classify(frame)[1] == phalanx
    both = LoadCellProtocol(path, ["index"], {"index": ["STRAIN@0x182", "STRAIN"]})
    for frame, volts in zip(both.encode(0, np.array([1.5, -1.5]), sequence=0), (1.5, -1.5), strict=True):
        assert both.decode(data_of(both, [frame]))[0][int(volts < 0)] == volts
    for reference in ("STRAIN@", "STRAIN@x", "STRAIN@-1", "STRAIN@0x20000000"):
        with pytest.raises(CanError, match=f"'{reference}': expected an identifier such as 0x182"):
            LoadCellProtocol(path, ["index"], {"index": [reference]})
    with pytest.raises(CanError, match=r"0x181 STRAIN: .* found it in thumb and index; .*: STRAIN@0x182"):
        LoadCellProtocol(path, ["thumb", "index"], {"thumb": ["STRAIN"], "index": ["STRAIN"]})


def test_a_message_belongs_to_one_phalanx() -> None:
    path = resource_path("config/loadcells.dbc")
    with pytest.raises(CanError, match="0x102 index_a: expected it once, found it in index and other"):
        LoadCellProtocol(path, ["index", "other"], {"other": ["index_a"]})
